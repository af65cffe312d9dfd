"""The state of a run that the live page must show before all else."""

from dataclasses import dataclass
from typing import Literal

from placefield_tools.dashboard.commands import Commands
from placefield_tools.dashboard.service_words import can_answer, silent
from placefield_tools.dashboard.state import LiveState
from placefield_tools.status.service_status import RunStatus

Name = Literal["idle", "live", "ended", "router-gone", "services-missing", "wrong-map"]


@dataclass(frozen=True)
class RunState:
    """What is the matter with a run.

    Attributes:
        name: of the state.
        words: the banner; empty if all is well.
        is_current: whether the shown match may still be where the vehicle is.
    """

    name: Name
    words: str = ""
    is_current: bool = True

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
    if wrong := _wrong_map(state, status, commands):
        return RunState("wrong-map", wrong, False)
    if absent := _absent(status, commands):
        return RunState("services-missing", absent, can_answer(status))
    if state.ended is not None and state.summary is not None:
        return RunState("ended", f"The stream is over: {state.summary.words()}.")
    if not state.answers:
        return RunState("idle", "Waiting for frames. Start a replay here, or in a terminal:")
    return RunState("live")


def _absent(status: RunStatus, commands: Commands) -> str:
    """Name the services that are missing or silent, and say what to do; empty if all are there."""
    words = []
    if status.missing:
        words.append(f"Not running: {', '.join(status.missing)}.")
        words.append(f"Start them with '{commands.up}'.")
    if hanging := silent(status):
        words.append(f"Running, but silent: {', '.join(hanging)}.")
        words.append("See the log of 'placefield up'.")
    return " ".join(words)


def _wrong_map(state: LiveState, status: RunStatus, commands: Commands) -> str:
    """Say who has another map than this page, and what to do; empty if nobody has."""
    own = state.placemap.digest
    maps = {each.name: each.map for each in status.services if each.map is not None}
    others = {name: digest for name, digest in maps.items() if digest != own}
    found = {*others.values(), *filter(None, [state.foreign_map])}
    if not found:
        return ""
    another = f"another map (digest {', '.join(sorted(found))})"
    shown = f"{commands.map_path} (digest {own})"
    if own in maps.values():
        return (
            f"Wrong map: {', '.join(others) or 'a service'} with {another}, this page and the "
            f"other services with {shown}. Start all services with one map: '{commands.up}'."
        )
    return (
        f"Wrong map: this page shows {shown}, but the services use {another}. Start the page with "
        f"their map: '{commands.dashboard}', or the services with this one: '{commands.up}'. "
        "'placefield inspect MAP' says the digest of a map."
    )
