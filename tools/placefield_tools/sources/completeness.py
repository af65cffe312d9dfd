"""The number of missing frames of a video, by its container's count and by the stamps."""

from pathlib import Path

from placefield_tools.sources.matroska import ends_too_early, is_matroska

_EVEN_SHARE = 0.9
_ROUNDING_NS = 1_500_000  # containers keep milliseconds


class Completeness:
    """Counts the frames that a video gives, and computes how many are missing.

    AVI, and MP4 and its relatives, store the number of frames. In other containers, the number is
    estimated from the duration, which may be that of the sound. There, missing frames show as gaps
    between evenly spaced stamps, or as an end that is early by more than a second and by more than
    a tenth of the video. Matroska stores the length of its file, so its end counts as early only if
    the file is too short.
    """

    def __init__(self, path: Path, total: int, rate: float) -> None:
        """Begin with the file, the container's number of frames, and its frames per second."""
        with path.open("rb") as file:
            head = file.read(12)
        self._is_counted = head[4:8] == b"ftyp" or (head[:4], head[8:]) == (b"RIFF", b"AVI ")
        self._is_whole = is_matroska(head) and not ends_too_early(path)
        self.total = total
        self._rate = rate if rate > 0 else 1.0
        self._stamp_ns: int | None = None
        self._steps = self._even = self._skipped = 0

    def note(self, stamp_ns: int) -> None:
        """Note the stamp of the next frame."""
        if self._stamp_ns is not None:
            step_ns, even_ns = stamp_ns - self._stamp_ns, 1e9 / self._rate
            turns = max(1, round(step_ns / even_ns))
            self._steps += 1
            self._even += abs(step_ns - turns * even_ns) <= _ROUNDING_NS and turns == 1
            self._skipped += turns - 1
        self._stamp_ns = stamp_ns

    def missing(self, given: int) -> int:
        """Return how many frames are missing, after ``given`` frames, readable or not."""
        behind = max(0, self.total - given)
        if self._is_counted:
            return behind
        is_even = self._steps > 0 and self._even >= _EVEN_SHARE * self._steps
        skipped = self._skipped if is_even else 0
        cut_off = behind - skipped
        is_cut_off = not self._is_whole and cut_off > max(self._rate, self.total / 10)
        return skipped + (cut_off if is_cut_off else 0)
