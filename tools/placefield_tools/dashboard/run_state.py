"""The state of a run that the live page must show before all else."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

from placefield_tools.dashboard.commands import Commands
from placefield_tools.dashboard.service_words import can_answer, silent
from placefield_tools.dashboard.state import LiveState
from placefield_tools.status.service_status import RunStatus

Name = Literal["idle", "live", "ended", "router-gone", "services-missing", "wrong-map"]


class Step(NamedTuple):
    """What a person may do next: words, and the command for it."""

    words: str
    command: str


@dataclass(frozen=True)
class RunState:
    """What is the matter with a run.

    Attributes:
        name: of the state.
        words: the banner; empty if all is well.
        is_current: whether the shown match may still be where the vehicle is.
        steps: what a person may do next.
    """

    name: Name
    words: str = ""
    is_current: bool = True
    steps: tuple[Step, ...] = ()

    @property
    def is_fault(self) -> bool:
        """Whether something must be mended."""
        return self.name in ("router-gone", "services-missing", "wrong-map")


def run_state(
    state: LiveState, status: RunStatus, *, connected: bool, commands: Commands
) -> RunState:
    """Return the state of a run.

    Args:
        state: the newest answers.
        status: of the services.
        connected: whether the router answers.
        commands: that mend it.
    """
    if not connected:
        gone = f"The router at {commands.endpoint} does not answer. Waiting for it."
        return RunState("router-gone", gone, False)
    return (
        _wrong_map(state, status, commands)
        or _missing_services(status, commands)
        or _state_of_stream(state, commands)
    )


def _state_of_stream(state: LiveState, commands: Commands) -> RunState:
    if state.ending and state.summary is not None:
        return RunState("ended", f"{state.ending.capitalize()}: {state.summary.words()}.")
    if not state.answers:
        step = Step("or in a terminal:", commands.replay)
        return RunState("idle", "Waiting for frames. Start a replay above,", steps=(step,))
    return RunState("live")


def _missing_services(status: RunStatus, commands: Commands) -> RunState | None:
    """Name the services that are missing or silent, and say what to do."""
    words, steps = [], []
    if status.missing:
        words.append(f"Not running: {', '.join(status.missing)}.")
        steps.append(Step("Start them:", commands.up))
    if hanging := silent(status):
        words.append(f"Running, but silent: {', '.join(hanging)}.")
        words.append("See the log of 'placefield up'.")
    if not words:
        return None
    return RunState("services-missing", " ".join(words), can_answer(status), tuple(steps))


def _wrong_map(state: LiveState, status: RunStatus, commands: Commands) -> RunState | None:
    """Say who has another map than this page, and what to do."""
    own = state.placemap.digest
    maps = {each.name: each.map for each in status.services if each.map is not None}
    others = {name: digest for name, digest in maps.items() if digest != own}
    found = {*others.values(), *filter(None, [state.foreign_map])}
    if not found:
        return None
    another = f"another map (digest {', '.join(sorted(found))})"
    shown = f"{commands.map_path} (digest {own})"
    if own in maps.values():
        words = (
            f"Wrong map: {', '.join(others) or 'a service'} with {another}, this page and the "
            f"other services with {shown}."
        )
        step = Step("Start all services with one map:", commands.up)
        return RunState("wrong-map", words, False, (step,))
    words = f"Wrong map: this page shows {shown}, but the services use {another}."
    steps = (
        Step("Start the page with their map:", commands.dashboard),
        Step("Or the services with this map:", commands.up),
        Step("Which map has which digest:", commands.inspect),
    )
    return RunState("wrong-map", words, False, steps)
