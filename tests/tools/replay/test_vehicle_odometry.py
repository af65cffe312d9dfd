import time
from collections.abc import Iterator

import msgpack
import numpy as np
import pytest
from bus_readers import await_reader

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.bus.messages import OdometryMessage, StatsMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.features.frames import Frame
from placefield_tools.replay.vehicle_odometry import Odometry
from placefield_tools.sources import Source, open_source, source_factory
from placefield_tools.sources.distance_sampled import DistanceSampled
from placefield_tools.sources.with_odometry import WithOdometry

KEYS = Keys("test")


@pytest.fixture
def buses(endpoint: str) -> Iterator[tuple[Bus, Bus]]:
    config = BusConfig(endpoint=endpoint)
    with open_router(config) as one, open_bus(config) as other:
        yield one, other


def await_metres(odometry: Odometry, metres: float) -> None:
    until = time.monotonic() + 60
    while (reported := odometry.metres()) is None and time.monotonic() < until:
        time.sleep(0.01)
    assert reported == metres


def test_metres_add_up_over_restarts_of_the_vehicles_count_and_garbage_is_dropped(
    buses: tuple[Bus, Bus],
) -> None:
    vehicle, listener = buses
    odometry = Odometry()
    odometry.listen(listener, KEYS)
    assert odometry.metres() is None
    await_reader(listener, vehicle, KEYS)
    for said, metres in ((5.0, 5.0), (7.5, 7.5), (0.5, 8.0), (2.5, 10.0)):
        vehicle.put(KEYS.odometry, OdometryMessage(metres=said))
        await_metres(odometry, metres)
    vehicle.put(KEYS.odometry, StatsMessage(service="wheels", counts={}))
    vehicle.put(KEYS.odometry, OdometryMessage(metres=3.0))
    await_metres(odometry, 10.5)


def test_metres_are_reported_once_even_where_the_vehicle_stands_and_none_when_it_is_silent(
    buses: tuple[Bus, Bus],
) -> None:
    vehicle, listener = buses
    odometry = Odometry()
    odometry.listen(listener, KEYS)
    await_reader(listener, vehicle, KEYS)
    for _ in range(2):
        vehicle.put(KEYS.odometry, OdometryMessage(metres=5.0))
        await_metres(odometry, 5.0)
        assert odometry.metres() is None


def test_more_metres_than_there_are_numbers_for_are_dropped(buses: tuple[Bus, Bus]) -> None:
    vehicle, listener = buses
    odometry = Odometry()
    odometry.listen(listener, KEYS)
    await_reader(listener, vehicle, KEYS)
    vehicle.put(KEYS.odometry, OdometryMessage(metres=1.5e308))
    await_metres(odometry, 1.5e308)
    vehicle.put(KEYS.odometry, OdometryMessage(metres=1e308))
    vehicle.put(KEYS.odometry, OdometryMessage(metres=1.6e308))
    await_metres(odometry, 1.6e308)


def test_an_odometry_message_is_two_fields_of_msgpack() -> None:
    by_hand = msgpack.packb({"version": 3, "metres": 12.5})
    assert OdometryMessage.decode(by_hand) == OdometryMessage(metres=12.5)


class Clip(Source):
    """Ten frames of a camera."""

    count = None
    live = True

    def __iter__(self) -> Iterator[Frame]:
        for index in range(10):
            yield Frame(index, index, f"{index}", np.zeros((2, 2), np.uint8))


def test_a_cameras_frames_are_spaced_by_what_the_vehicle_says() -> None:
    said = iter([None, None, 0.0, 0.4, 0.9, 1.1, None, 1.9, 2.0, 5.0])
    spaced = DistanceSampled(WithOdometry(Clip(), lambda: next(said)), 1.0)
    assert spaced.live
    assert [frame.index for frame in spaced] == [2, 5, 8, 9]


def test_a_cameras_frames_have_the_metres_that_were_said_since_the_frame_before() -> None:
    said = [None, 0.0, 0.0, None, None, 3.0, 3.5, None, 4.0, None]
    in_turn = iter(said)
    with_odometry = WithOdometry(Clip(), lambda: next(in_turn))
    assert [frame.odometry_m for frame in with_odometry] == said


@pytest.mark.parametrize(("spacing_m", "taken"), [(None, [*range(10)]), (1.0, [1, 4, 9])])
def test_a_camera_that_is_opened_has_the_vehicles_odometry_spaced_or_not(
    monkeypatch: pytest.MonkeyPatch, spacing_m: float | None, taken: list[int]
) -> None:
    monkeypatch.setattr(source_factory, "Camera", lambda *_, **__: Clip())
    said = [None, 0.0, 0.5, None, 1.5, 1.5, None, 1.75, None, 2.5]
    in_turn = iter(said)
    with open_source("camera:0", spacing_m=spacing_m, metres=lambda: next(in_turn)) as source:
        frames = [(frame.index, frame.odometry_m) for frame in source]
    assert frames == [(index, said[index]) for index in taken]
