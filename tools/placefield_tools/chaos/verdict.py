"""What a stream that was disturbed has come to, against one that was not."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from placefield.fusion.match import Match
from placefield_tools.chaos.schedule import Fault


@dataclass(frozen=True)
class Happened:
    """A fault, and when.

    Attributes:
        fault: which one.
        sent: how many frames had been sent.
        at: monotonic seconds.
    """

    fault: Fault
    sent: int
    at: float


@dataclass(frozen=True)
class Answered:
    """The match of a frame, and when it came, monotonic seconds."""

    match: Match
    at: float


@dataclass(frozen=True)
class Recovery:
    """How long after a fault all was well; None: it never was."""

    fault: Fault
    seconds: float | None


@dataclass(frozen=True)
class Verdict:
    """What was counted.

    Attributes:
        sent: frames.
        answered: frames.
        partial: frames answered without some channels, or after the stream's memory was lost, and
            flagged so.
        wrong: frames answered otherwise than undisturbed, and not flagged.
        recoveries: by fault.
    """

    sent: int
    answered: int
    partial: int
    wrong: int
    recoveries: tuple[Recovery, ...]

    @property
    def recover_s(self) -> float | None:
        """The longest that anything took to be well again; None: it never was.

        What happened just before the end counts only if the stream still showed it.
        """
        seconds = [
            recovery.seconds
            for recovery in self.recoveries
            if recovery.seconds is not None or not recovery.fault.is_last
        ]
        known = [second for second in seconds if second is not None]
        return max(known, default=0.0) if len(known) == len(seconds) else None

    @property
    def holds(self) -> bool:
        """Whether nothing was lost, nothing wrong, and all was well again."""
        return not self.wrong and self.answered == self.sent and self.recover_s is not None

    def as_json(self) -> dict[str, Any]:
        """Return the counts, and the faults with the time that each took."""
        faults = [asdict(each.fault) | {"recover_s": each.seconds} for each in self.recoveries]
        counts = {name: getattr(self, name) for name in ("sent", "answered", "partial", "wrong")}
        return counts | {"recover_s": self.recover_s, "faults": faults}


def judge(
    undisturbed: Sequence[Match],
    answers: Mapping[int, Answered],
    happened: Sequence[Happened],
    sent: int,
) -> Verdict:
    """Hold the answers, by frame, against those of the undisturbed run, in order of frames.

    A system has recovered from a fault when it first answers with all channels a frame that was
    sent after it; what was under way at the fault says nothing. Where all who remembered the stream
    died, later answers are marked so to its end, and it has recovered all the same.
    """
    complete = {frame: each for frame, each in answers.items() if not each.match.missing}
    whole = {frame: each for frame, each in complete.items() if not each.match.forgotten}
    return Verdict(
        sent=sent,
        answered=len(answers),
        partial=len(answers) - len(whole),
        wrong=sum(each.match != undisturbed[frame] for frame, each in whole.items()),
        recoveries=tuple(_recovery(each, complete) for each in happened),
    )


def _recovery(happened: Happened, complete: Mapping[int, Answered]) -> Recovery:
    after = [each.at for frame, each in complete.items() if frame >= happened.sent]
    return Recovery(happened.fault, min(after) - happened.at if after else None)
