"""Frames and distances to encoded images."""

from collections.abc import Sequence

import cv2
import numpy as np

from placefield.bus.messages import FrameMessage
from placefield.features.images import check_pixels, decode
from placefield_tools.dashboard.distances import Row

_WIDTH = 640  # of a frame as it is shown, pixels, at most
_QUALITY = 80


def frame_picture(payload: bytes) -> bytes:
    """Return a frame's message as a JPEG image of moderate size.

    Raises:
        MessageError: it is no frame's.
        FrameError: it cannot be read.
    """
    image = FrameMessage.decode(payload).image
    pixels = decode(image) if isinstance(image, bytes) else image
    check_pixels(pixels)
    if pixels.shape[1] > _WIDTH:
        height = max(round(pixels.shape[0] * _WIDTH / pixels.shape[1]), 1)
        pixels = np.asarray(cv2.resize(pixels, (_WIDTH, height), interpolation=cv2.INTER_AREA))
    _, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return encoded.tobytes()


def distance_picture(rows: Sequence[Row | None], columns: int) -> bytes:
    """Return distances as a PNG image: frames to the right, places upwards, near is dark.

    The grey spans the 1st to the 99th percentile. Frames whose distances are not known are white.
    """
    shades = np.full((len(rows), columns), 255, np.uint8)
    known = [number for number, row in enumerate(rows) if row is not None]
    if known:
        distances = np.stack([row for row in rows if row is not None])
        near, far = np.percentile(distances, (1, 99))
        scaled = (distances - near) / max(far - near, 1e-9)
        shades[known] = np.clip(scaled * 215 + 40, 40, 255).astype(np.uint8)
    _, encoded = cv2.imencode(".png", np.ascontiguousarray(shades.T[::-1]))
    return encoded.tobytes()
