"""How many frames of a video did not come, by what its container says and by their stamps."""

from pathlib import Path

from placefield_tools.sources.matroska import ends_too_early, is_matroska

_EVEN_SHARE = 0.9
_ROUNDING_NS = 1_500_000  # containers keep milliseconds


class Completeness:
    """Notes the frames of a video that come, and says how many have not.

    AVI, and MP4 and its kin, count their frames. Of other containers the count is an estimate, by
    how long they last, sound and all; there a gap tells in frames that else come evenly, and an end
    that comes more than a second, and a tenth, too early. Matroska says how long its file is, and
    its end is early only where the file's is.
    """

    def __init__(self, path: Path, total: int, rate: float) -> None:
        """Take the file, and the container's count and frames per second."""
        with path.open("rb") as file:
            head = file.read(12)
        self._is_counted = head[4:8] == b"ftyp" or (head[:4], head[8:]) == (b"RIFF", b"AVI ")
        self._is_whole = is_matroska(head) and not ends_too_early(path)
        self.total = total
        self._rate = rate if rate > 0 else 1.0
        self._stamp_ns: int | None = None
        self._steps = self._even = self._skipped = 0

    def note(self, stamp_ns: int) -> None:
        """Note the next frame that came."""
        if self._stamp_ns is not None:
            step_ns, even_ns = stamp_ns - self._stamp_ns, 1e9 / self._rate
            turns = max(1, round(step_ns / even_ns))
            self._steps += 1
            self._even += abs(step_ns - turns * even_ns) <= _ROUNDING_NS and turns == 1
            self._skipped += turns - 1
        self._stamp_ns = stamp_ns

    def missing(self, given: int) -> int:
        """Return how many did not come, of whom ``given`` came or kept their turn."""
        behind = max(0, self.total - given)
        if self._is_counted:
            return behind
        is_even = self._steps > 0 and self._even >= _EVEN_SHARE * self._steps
        skipped = self._skipped if is_even else 0
        cut_off = behind - skipped
        is_cut_off = not self._is_whole and cut_off > max(self._rate, self.total / 10)
        return skipped + (cut_off if is_cut_off else 0)
