"""Compressed video in a recording, with one frame per message."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError

_CODECS = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "vp9": "vp9", "av1": "av1"}


class VideoDecoder:
    """Decodes the frames of one topic, which must come in order and without gaps."""

    def __init__(self) -> None:
        """Prepare for a video.

        Raises:
            ConfigError: PyAV is not installed.
        """
        try:
            import av
        except ModuleNotFoundError:
            raise ConfigError(
                "its images are video, which needs av: pip install 'placefield[ros]'"
            ) from None
        self._av: Any = av
        self._codec: Any = None

    def update(self, form: str, data: bytes) -> NDArray[np.uint8] | None:
        """Return the image (H, W, 3) BGR of the next message; None before the first key frame.

        Args:
            form: h264, h265, vp9 or av1.
            data: the frame.

        Raises:
            FrameError: the frame does not decode, or the format is not supported.
        """
        try:
            if self._codec is None:
                name = _CODECS.get(form.lower())
                if name is None:
                    raise FrameError(f"video of {form!r}; give one of {', '.join(_CODECS)}")
                self._codec = self._av.CodecContext.create(name, "r")
                self._codec.thread_count = 1  # several threads would delay frames
            frames = self._codec.decode(self._av.Packet(data))
        except self._av.FFmpegError as error:
            raise FrameError(f"video of {form} does not decode ({error!s:.100})") from None
        if not frames:
            return None
        picture: NDArray[np.uint8] = frames[-1].to_ndarray(format="bgr24")
        return picture
