from dataclasses import replace
from pathlib import Path

import pytest

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.config import BusConfig
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map
from placefield_tools.dashboard.commands import Commands
from placefield_tools.dashboard.run_state import RunState, Step, run_state
from placefield_tools.dashboard.state import LiveState
from placefield_tools.status.service_status import RunStatus, ServiceStatus

OTHER = "f" * 16
COMMANDS = Commands("night", Path("my maps/route.pfmap"), BusConfig().endpoint)
UP = "placefield up 'my maps/route.pfmap' --run night"


@pytest.fixture
def state(route_map: Map) -> LiveState:
    return LiveState(replace(route_map, digest=NO_DIGEST), tolerance=3)


def found(state: LiveState, *missing: str, connected: bool = True) -> RunState:
    status = RunStatus(None, None, None, (), missing)
    return run_state(state, status, connected=connected, commands=COMMANDS)


def add(state: LiveState, *, digest: str = NO_DIGEST) -> None:
    message = MatchMessage(map=digest, place=3, score=1.0, known=True)
    state.add_match(Header(stream="s", sequence=0, stamp_ns=0), message.encode())


def test_a_run_is_idle_then_live_then_over(state: LiveState) -> None:
    idle = found(state)
    assert idle.name == "idle"
    replay = Step("or in a terminal:", "placefield replay SOURCE --run night")
    assert idle.steps == (replay,)
    add(state)
    assert found(state) == RunState("live")
    state.add_match(Header(stream="s", sequence=1, stamp_ns=0, end=True), b"")
    ended = found(state)
    assert ended.name == "ended"
    assert ended.words.startswith("The stream is over: 1 frame, 1 known at once")
    assert ended.is_current


def test_a_stream_that_was_stopped_by_hand_is_said_to_be(state: LiveState) -> None:
    add(state)
    state.note_stop()
    assert found(state) == RunState("live")  # until it has ended
    state.add_match(Header(stream="s", sequence=1, stamp_ns=0, end=True), b"")
    assert found(state).words.startswith("Stopped by hand: 1 frame, ")


def test_a_stream_that_is_over_was_not_stopped_by_who_stops_the_next_one(state: LiveState) -> None:
    add(state)
    state.add_match(Header(stream="s", sequence=1, stamp_ns=0, end=True), b"")
    state.note_stop()  # before a frame of the next stream is answered
    assert found(state).words.startswith("The stream is over: ")


def test_what_is_wrong_comes_before_what_is_going_on(state: LiveState) -> None:
    add(state)
    gone = found(state, "fuser", connected=False)
    assert (gone.name, gone.is_current) == ("router-gone", False)
    missing = found(state, "fuser", "channel 2")
    assert (missing.name, missing.is_current) == ("services-missing", False)
    assert missing.words == "Not running: fuser, channel 2."
    assert missing.steps == (Step("Start them:", UP),)
    assert found(state, "channel 2").is_current  # the others still answer


def test_the_services_that_are_missing_and_those_that_are_silent_are_named_together(
    state: LiveState,
) -> None:
    hanging = ServiceStatus("channel", "a", None, None, None, None, None, True, {"received": 1})
    status = RunStatus(None, None, None, (hanging,), ("fuser",))
    both = run_state(state, status, connected=True, commands=COMMANDS)
    assert both.words == (
        "Not running: fuser. Running, but silent: channel. See the log of 'placefield up'."
    )
    assert both.steps == (Step("Start them:", UP),)


def served(state: LiveState, **maps: str) -> RunState:
    services = tuple(
        ServiceStatus(name, "a", None, None, None, None, None, False, {}, digest)
        for name, digest in maps.items()
    )
    return run_state(
        state, RunStatus(None, None, None, services, ()), connected=True, commands=COMMANDS
    )


def test_a_page_of_another_map_than_the_services_names_both_and_what_to_run(
    state: LiveState,
) -> None:
    words = (
        f"Wrong map: this page shows my maps/route.pfmap (digest {NO_DIGEST}), but the services "
        f"use another map (digest {OTHER})."
    )
    steps = (
        Step("Start the page with their map:", "placefield dashboard MAP --run night"),
        Step("Or the services with this map:", UP),
        Step("Which map has which digest:", "placefield inspect MAP"),
    )
    assert served(state, fuser=OTHER) == RunState("wrong-map", words, False, steps)
    add(state, digest=OTHER)  # before a service has reported
    assert found(state).words == words
    add(state)
    assert found(state).name == "live"


def test_a_service_of_another_map_than_the_others_is_named(state: LiveState) -> None:
    assert served(state, fuser=NO_DIGEST).name == "idle"
    differs = served(state, fuser=NO_DIGEST, channel=OTHER)
    assert differs.words == (
        f"Wrong map: channel with another map (digest {OTHER}), this page and the other services "
        f"with my maps/route.pfmap (digest {NO_DIGEST})."
    )
    assert differs.steps == (Step("Start all services with one map:", UP),)


def test_a_service_that_hangs_is_as_bad_as_one_that_is_missing(state: LiveState) -> None:
    def of(service: str, **counts: int) -> RunState:
        hanging = ServiceStatus(service, "a", None, None, None, None, None, True, counts)
        status = RunStatus(None, None, None, (hanging,), ())
        return run_state(state, status, connected=True, commands=COMMANDS)

    add(state)
    assert of("channel", received=3) == RunState(
        "services-missing",
        "Running, but silent: channel. See the log of 'placefield up'.",
    )
    assert not of("fuser", received=3).is_current
    assert of("fuser").name == "live"  # it has just begun
