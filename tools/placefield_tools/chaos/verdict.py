"""Compares the answers of a stream with faults with those of an undisturbed one."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from placefield.fusion.match import Match
from placefield_tools.chaos.schedule import Fault


@dataclass(frozen=True)
class Happened:
    """A fault that happened.

    Attributes:
        fault: the fault.
        sent: number of frames sent before it.
        at: its time, in monotonic seconds.
    """

    fault: Fault
    sent: int
    at: float


@dataclass(frozen=True)
class Answered:
    """The match of a frame, and the time it came, in monotonic seconds."""

    match: Match
    at: float


@dataclass(frozen=True)
class Recovery:
    """The seconds from a fault to recovery; None if the system did not recover."""

    fault: Fault
    seconds: float | None


@dataclass(frozen=True)
class Verdict:
    """The counts of a run with faults.

    Attributes:
        sent: number of frames sent.
        answered: number of frames answered.
        partial: number of answers flagged as partial: without some channels, or after the services
            forgot a part of the stream.
        wrong: number of answers without a flag that differ from the undisturbed ones.
        recoveries: recovery from each fault.
    """

    sent: int
    answered: int
    partial: int
    wrong: int
    recoveries: tuple[Recovery, ...]

    @property
    def recover_s(self) -> float | None:
        """The longest recovery, in seconds; None if the system did not recover from a fault.

        A fault just before the end counts only if the stream still showed the recovery.
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
        """Whether no frame was lost, no answer was wrong, and every fault was recovered from."""
        return not self.wrong and self.answered == self.sent and self.recover_s is not None

    def as_json(self) -> dict[str, Any]:
        """Return the counts, and the faults with their recovery times."""
        faults = [asdict(each.fault) | {"recover_s": each.seconds} for each in self.recoveries]
        counts = {name: getattr(self, name) for name in ("sent", "answered", "partial", "wrong")}
        return counts | {"recover_s": self.recover_s, "faults": faults}


def judge(
    undisturbed: Sequence[Match],
    answers: Mapping[int, Answered],
    happened: Sequence[Happened],
    sent: int,
) -> Verdict:
    """Compare the answers, by frame, with those of the undisturbed run, in order of frames.

    The system has recovered from a fault at the first answer with all channels to a frame sent
    after the fault. If all services that cached the stream died, later answers are flagged as
    forgotten to the end of the stream; this still counts as recovered.
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
