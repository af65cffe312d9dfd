"""Many cameras on one map: one set of services for all, beside one set per camera."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.host_chain import Chain, started
from placefield_tools.bench.load import Answers, LiveCamera, play, play_each
from placefield_tools.bench.ratio import Ratio
from placefield_tools.bench.street_frames import street_frames
from placefield_tools.bench.timing import repeat
from placefield_tools.common.own_command import PLACEFIELD

CAMERAS = 16
_TOO_MANY = 32
_RATE = 10.0  # frames per second and camera
_SECONDS = 5.0  # of a turn
_TURNS_ALONE = 6
_LIMIT_S = 120.0
_WARM_UP_S = 2.0
_FRAMES = 640  # of the route that they drive
_SIZE = (320, 240)
_CONNECT_S = 180  # many processes start at once


@dataclass(frozen=True)
class Load:
    """What the services did with all cameras' frames, and how long they computed for it.

    Attributes:
        answers: of all cameras.
        cpu_s: seconds of computing time, of all processes.
    """

    answers: Answers
    cpu_s: float

    @classmethod
    def of_all(cls, turns: "Sequence[Load]") -> "Load":
        """Return what the services did in all turns together."""
        latencies = np.concatenate([turn.answers.latencies for turn in turns])
        answers = Answers(sum(turn.answers.sent for turn in turns), latencies)
        return cls(answers, sum(turn.cpu_s for turn in turns))

    def figures(
        self,
        prefix: str,
        whose: str,
        *,
        most_lost: float | None = None,
        most_cpu_ms: float | None = None,
    ) -> list[Figure]:
        """Make figures of it, with these bars."""
        median, late = np.quantile(self.answers.latencies * 1e3, (0.5, 0.95))
        sent, lost = self.answers.sent, self.answers.lost
        return [
            Figure(f"{prefix}_lost_frames", lost, f"{whose}: of {sent} frames", at_most=most_lost),
            Figure(f"{prefix}_latency_ms", median, f"{whose}: median latency"),
            Figure(f"{prefix}_latency_95_ms", late, f"{whose}: 95th percentile"),
            Figure(
                f"{prefix}_cpu_ms",
                self.cpu_ms,
                f"{whose}: computing time per answered frame",
                at_most=most_cpu_ms,
            ),
        ]

    @property
    def cpu_ms(self) -> float:
        """Computing time per answered frame, milliseconds."""
        return 1e3 * self.cpu_s / len(self.answers.latencies)


def camera_figures(map_path: Path) -> list[Figure]:
    """Measure 16 cameras at 10 frames/s, JPEGs of 320 x 240, through one set and through 16.

    The one set is measured while no other runs, and then in turn with the others.

    Args:
        map_path: of a map.
    """
    frames = street_frames(_FRAMES, size=_SIZE, shift=8)
    runs = [f"camera{number}" for number in range(CAMERAS)]
    with _serving(map_path, [runs]) as together:
        together.play(frames, _WARM_UP_S)
        alone = [together.play(frames, _SECONDS) for _ in range(_TURNS_ALONE)]
        with _serving(map_path, [[run] for run in runs]) as separate:
            separate.play(frames, _WARM_UP_S)
            turns = _in_turn(together, separate, frames)
    return [*load_figures(alone, turns), *_figures_of_too_many(map_path, frames)]


def _in_turn(
    together: "_Layout", separate: "_Layout", frames: Sequence[bytes]
) -> list[tuple[Load, Load]]:
    turns: list[tuple[Load, Load]] = []

    def turn() -> list[float]:
        turns.append((together.play(frames, _SECONDS), separate.play(frames, _SECONDS)))
        return [load.cpu_ms for load in turns[-1]]

    repeat(turn, [(1, 0)], limit_s=_LIMIT_S)
    return turns


def _figures_of_too_many(map_path: Path, frames: Sequence[bytes]) -> list[Figure]:
    """Measure more cameras than two cores can follow, through one set of services."""
    runs = [f"camera{number}" for number in range(_TOO_MANY)]
    with started([_up(map_path, runs)]) as chains, _cameras(chains, [runs]) as cameras:
        play_each(cameras, frames, rate=_RATE, seconds=_WARM_UP_S)
        return share_figures(play_each(cameras, frames, rate=_RATE, seconds=_SECONDS))


def share_figures(answers: Sequence[Answers]) -> list[Figure]:
    """Make figures of how the answers are shared among cameras that are too many."""
    shares = [len(each.latencies) / each.sent for each in answers]
    whose = f"{len(answers)} cameras at {_RATE:g} frames/s, one set of services"
    return [
        Figure("too_many_answered", float(np.mean(shares)), f"{whose}: share of frames answered"),
        Figure(
            "too_many_fairness",
            min(shares) / max(*shares, 1e-9),
            "the least share of a camera over the greatest",
            at_least=0.7,
        ),
    ]


def load_figures(alone: Sequence[Load], turns: Sequence[tuple[Load, Load]]) -> list[Figure]:
    """Compare, turn by turn, one set of services for all cameras with a set for each camera.

    Args:
        alone: of the one set, while no other ran.
        turns: of the one set, and of the others.
    """
    separate = Load.of_all([others for _, others in turns])
    cpu_ms = np.array([[load.cpu_ms for load in turn] for turn in turns])
    return [
        *Load.of_all(alone).figures(
            "cameras", "one set of services for 16 cameras", most_lost=0, most_cpu_ms=7
        ),
        *separate.figures("cameras_separate", "16 sets of services"),
        Figure(
            "cameras_cpu_ratio",
            Ratio.of(cpu_ms[:, 1], cpu_ms[:, 0]),
            "computing time per answered frame, 16 sets over one",
        ),
    ]


class _Layout:
    """Cameras, and the sets of services that serve them."""

    def __init__(self, chains: Sequence[Chain], cameras: Sequence[LiveCamera]) -> None:
        self._chains, self._cameras = chains, cameras

    def play(self, frames: Sequence[bytes], seconds: float) -> Load:
        """Publish frames of all cameras for so long."""
        before = self._cpu_seconds()
        answers = play(self._cameras, frames, rate=_RATE, seconds=seconds)
        return Load(answers, self._cpu_seconds() - before)

    def _cpu_seconds(self) -> float:
        return sum(chain.cpu_seconds() for chain in self._chains)


@contextmanager
def _serving(map_path: Path, sets: Sequence[Sequence[str]]) -> Iterator[_Layout]:
    """Start sets of services; each set serves some runs."""
    commands = [_up(map_path, runs) for runs in sets]
    with started(commands) as chains, _cameras(chains, sets) as cameras:
        yield _Layout(chains, cameras)


def _up(map_path: Path, runs: Sequence[str]) -> list[str]:
    command = [*PLACEFIELD, "up", str(map_path)]
    command += ["--set", f"bus.connect_timeout_s={_CONNECT_S}"]
    return [*command, *(flag for run in runs for flag in ("--run", run))]


@contextmanager
def _cameras(chains: Sequence[Chain], sets: Sequence[Sequence[str]]) -> Iterator[list[LiveCamera]]:
    with ExitStack() as stack:
        cameras = []
        for chain, runs in zip(chains, sets, strict=True):
            bus = stack.enter_context(open_bus(BusConfig(endpoint=chain.endpoint)))
            cameras += [LiveCamera(bus, run) for run in runs]
        yield cameras
