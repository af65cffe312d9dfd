"""The state of a run that the live page must show before all else."""

from dataclasses import dataclass
from typing import Literal

from placefield_tools.dashboard.missing_services import can_answer, silent
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


def run_state(state: LiveState, status: RunStatus, *, connected: bool, run: str) -> RunState:
    """Return the state of a run.

    Args:
        state: the newest answers.
        status: of the services.
        connected: whether the router answers.
        run: name of the run.
    """
    if not connected:
        return RunState("router-gone", "The router does not answer. Waiting for it.", False)
    if wrong := _wrong_map(state, status):
        return RunState("wrong-map", wrong, False)
    if absent := _absent(status, run):
        return RunState("services-missing", absent, can_answer(status))
    if state.ended is not None and state.summary is not None:
        return RunState("ended", f"The stream is over: {state.summary.words()}.")
    if not state.answers:
        return RunState("idle", "Waiting for frames. Start a replay here, or in a terminal:")
    return RunState("live")


def _absent(status: RunStatus, run: str) -> str:
    """Name the services that are missing or silent, and say what to do; empty if all are there."""
    words = []
    if status.missing:
        words.append(f"Not running: {', '.join(status.missing)}.")
        words.append(f"Start them with 'placefield up MAP --run {run}'.")
    if hanging := silent(status):
        words.append(f"Running, but silent: {', '.join(hanging)}.")
        words.append("Look into the log of 'placefield up'.")
    return " ".join(words)


def _wrong_map(state: LiveState, status: RunStatus) -> str:
    """Name what has another map than this page; empty if nothing has."""
    own = state.placemap.digest
    if state.foreign_map is not None:
        return (
            f"Wrong map: the answers are of map {state.foreign_map}, and this page has {own}. "
            "Start the dashboard with the map of the services."
        )
    others = [each for each in status.missing if " on map " in each]
    return f"Wrong map: {'; '.join(others)}." if others else ""
