"""What a command leaves that the fixture ``placefield`` ran."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Ended:
    """What a command left."""

    code: int
    out: str
    err: str

    @property
    def refusal(self) -> str:
        """The one line that says why the command could not go on."""
        assert self.code == 1, self
        assert not self.out
        lines = [line for line in self.err.splitlines() if line.startswith("placefield: ")]
        assert len(lines) == 1, self.err
        assert self.err.rstrip().endswith(lines[0]), self.err
        return lines[0]


Run = Callable[..., Ended]
