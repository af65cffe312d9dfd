"""Send the frames of a camera to the services, and print where the vehicle is.

    placefield up route.pfmap             # in another terminal
    python examples/camera.py 0           # the number of a camera, or a video

A camera does not wait: frames that the services cannot follow are left out, and have no place. A
video waits, so that each of its frames has a match.
"""

import sys
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield import UNANSWERED, connect


def frames(camera: str) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a camera, or of a video up to its end: (H, W, 3) BGR."""
    capture = cv2.VideoCapture(int(camera) if camera.isdigit() else camera)
    while True:
        there, pixels = capture.read()
        if not there:
            return
        yield pixels.astype(np.uint8, copy=False)


def main(camera: str) -> None:
    """Print a line for each frame that was matched."""
    with connect() as client:  # at PLACEFIELD_BUS__ENDPOINT, or this host's services
        for number, match in enumerate(client.stream(frames(camera), live=camera.isdigit())):
            if match.place != UNANSWERED:
                sure = "" if match.known else "?"
                print(f"frame {number}: place {match.place}{sure}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
