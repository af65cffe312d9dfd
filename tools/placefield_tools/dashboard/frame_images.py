"""Encodes frames and distances as images."""

from collections.abc import Sequence

import cv2
import numpy as np

from placefield.bus.messages import FrameMessage
from placefield_tools.dashboard.distance_columns import Row
from placefield_tools.record.thumbnails import picture_of


def frame_picture(payload: bytes) -> bytes | None:
    """Return the image of a frame message as a JPEG image of moderate size, see ``picture_of``.

    Raises:
        MessageError: it is no frame's.
        FrameError: it cannot be read.
    """
    return picture_of(FrameMessage.decode(payload))


def distance_picture(rows: Sequence[Row | None], columns: int) -> bytes:
    """Return distances as a PNG image: frames to the right, places upwards, small distances dark.

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
