"""CDR written by hand, from the specification: what rosbags' bytes are held to."""

import struct
from collections.abc import Sequence


class Cdr:
    """Plain CDR, version 1: each number is aligned to its size, from behind the encapsulation."""

    def __init__(self, order: str = "<") -> None:
        self._order = order
        self._body = b""

    def __bytes__(self) -> bytes:
        return (b"\0\1\0\0" if self._order == "<" else b"\0\0\0\0") + self._body

    def put(self, code: str, *numbers: float) -> "Cdr":
        for number in numbers:
            self._body += b"\0" * (-len(self._body) % struct.calcsize(code))
            self._body += struct.pack(self._order + code, number)
        return self

    def text(self, text: str) -> "Cdr":
        encoded = text.encode() + b"\0"
        self.put("I", len(encoded))
        self._body += encoded
        return self

    def octets(self, data: bytes) -> "Cdr":
        self.put("I", len(data))
        self._body += data
        return self

    def header(self, seconds: int, nanoseconds: int, frame_id: str) -> "Cdr":
        return self.put("i", seconds).put("I", nanoseconds).text(frame_id)


def compressed_image(stamp: tuple[int, int], data: bytes, order: str = "<") -> bytes:
    return bytes(Cdr(order).header(*stamp, "camera").text("jpeg").octets(data))


def image(
    stamp: tuple[int, int],
    height: int,
    width: int,
    encoding: str,
    step: int,
    data: bytes,
    order: str = "<",
) -> bytes:
    message = Cdr(order).header(*stamp, "camera").put("I", height, width).text(encoding)
    return bytes(message.put("B", 0).put("I", step).octets(data))


def odometry(position: Sequence[float], order: str = "<") -> bytes:
    message = Cdr(order).header(1, 2, "odom").text("base_link")
    message.put("d", *position, 0, 0, 0, 1, *[0] * 36)  # pose
    return bytes(message.put("d", *[0] * 6, *[0] * 36))  # twist


def camera_info(
    size: tuple[int, int],
    model: str,
    matrix: Sequence[float],
    distortion: Sequence[float],
) -> bytes:
    height, width = size
    message = Cdr().header(1, 2, "camera").put("I", height, width).text(model)
    message.put("I", len(distortion)).put("d", *distortion, *matrix, *[0] * 9, *[0] * 12)
    return bytes(message.put("I", 0, 0).put("I", 0, 0, 0, 0).put("B", 0))  # binning, roi
