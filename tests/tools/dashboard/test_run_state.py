from dataclasses import replace

import pytest

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map
from placefield_tools.dashboard.run_state import RunState, run_state
from placefield_tools.dashboard.state import LiveState
from placefield_tools.status.service_status import RunStatus, ServiceStatus

OTHER = "f" * 16


@pytest.fixture
def state(route_map: Map) -> LiveState:
    return LiveState(replace(route_map, digest=NO_DIGEST), tolerance=3)


def found(state: LiveState, *missing: str, connected: bool = True) -> RunState:
    status = RunStatus(None, None, None, (), missing)
    return run_state(state, status, connected=connected, run="night")


def add(state: LiveState, *, digest: str = NO_DIGEST) -> None:
    message = MatchMessage(map=digest, place=3, score=1.0, known=True)
    state.add_match(Header(stream="s", sequence=0, stamp_ns=0), message.encode())


def test_a_run_is_idle_then_live_then_over(state: LiveState) -> None:
    assert found(state).name == "idle"
    add(state)
    assert found(state) == RunState("live")
    state.add_match(Header(stream="s", sequence=1, stamp_ns=0, end=True), b"")
    ended = found(state)
    assert ended.name == "ended"
    assert "1 frame, 1 known at once" in ended.words
    assert ended.is_current


def test_what_is_wrong_comes_before_what_is_going_on(state: LiveState) -> None:
    add(state)
    gone = found(state, "fuser", connected=False)
    assert (gone.name, gone.is_current) == ("router-gone", False)
    missing = found(state, "fuser", "channel 2")
    assert (missing.name, missing.is_current) == ("services-missing", False)
    assert missing.words == (
        "Not running: fuser, channel 2. Start them with 'placefield up MAP --run night'."
    )
    assert found(state, "channel 2").is_current  # the others still answer


def test_the_services_that_are_missing_and_those_that_are_silent_are_named_together(
    state: LiveState,
) -> None:
    hanging = ServiceStatus("channel", "a", None, None, None, None, None, True, {"received": 1})
    status = RunStatus(None, None, None, (hanging,), ("fuser",))
    words = run_state(state, status, connected=True, run="night").words
    assert words == (
        "Not running: fuser. Start them with 'placefield up MAP --run night'. "
        "Running, but silent: channel. Look into the log of 'placefield up'."
    )


def test_answers_of_another_map_are_named_as_such(state: LiveState) -> None:
    add(state, digest=OTHER)
    wrong = found(state)
    assert (wrong.name, wrong.is_current) == ("wrong-map", False)
    assert f"of map {OTHER}, and this page has {NO_DIGEST}" in wrong.words
    add(state)
    assert found(state).name == "live"
    assert found(state, f"fuser ab on map {NO_DIGEST}: it has {OTHER}").name == "wrong-map"


def test_a_service_that_hangs_is_as_bad_as_one_that_is_missing(state: LiveState) -> None:
    def of(service: str, **counts: int) -> RunState:
        hanging = ServiceStatus(service, "a", None, None, None, None, None, True, counts)
        status = RunStatus(None, None, None, (hanging,), ())
        return run_state(state, status, connected=True, run="night")

    add(state)
    assert of("channel", received=3) == RunState(
        "services-missing",
        "Running, but silent: channel. Look into the log of 'placefield up'.",
    )
    assert not of("fuser", received=3).is_current
    assert of("fuser").name == "live"  # it has just begun
