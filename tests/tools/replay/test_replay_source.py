"""Replays against stand-ins for the services, in one process."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from frame_folders import uneven_drive
from lenses import pinhole

from placefield.bus import sending
from placefield.bus.connecting import open_bus, open_router
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, MatchMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield.errors import BusError, SourceError
from placefield.features.calibration import Calibration
from placefield.features.frames import Frame
from placefield.maps.digest import NO_DIGEST
from placefield_tools.replay import replay_source as replaying
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import Parts, Source, open_source
from placefield_tools.sources.with_odometry import WithOdometry

KEYS = Keys("test")


@pytest.fixture
def config(endpoint: str) -> Config:
    return Config(runs=("test",), bus=BusConfig(endpoint=endpoint, connect_timeout_s=60))


@pytest.fixture(autouse=True)
def _send_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no frame be sent again, unless a test says when, however slow the machine."""
    monkeypatch.setattr(sending, "_SEND_AGAIN_S", 1000.0)


@pytest.fixture
def router(config: Config) -> Iterator[Bus]:
    with open_router(config.bus) as bus:
        yield bus


class Services:
    """Takes frames and answers them, all at once or only when told to."""

    def __init__(self, bus: Bus, *, answering: bool = True) -> None:
        self.answering = answering
        self.headers: list[Header] = []
        self.images: list[bytes] = []
        self.calibrations: list[Calibration | None] = []
        self._odometry: dict[tuple[str, int], float | None] = {}
        self._matched: set[tuple[str, int]] = set()
        self._matches, self._acks = bus.publisher(KEYS.match), bus.publisher(KEYS.ack)
        bus.subscribe(KEYS.frame, self._receive, Counter())
        bus.declare_alive(KEYS.alive("featurizer", "stand-in"))
        bus.declare_alive(KEYS.alive("fuser", "stand-in"))

    def _receive(self, received: Received) -> None:
        self.headers.append(received.header)
        if not received.header.end:
            message = FrameMessage.decode(received.payload)
            image = message.image
            frame = received.header.stream, received.header.sequence
            assert self._odometry.setdefault(frame, message.odometry_m) == message.odometry_m
            self.images.append(image if isinstance(image, bytes) else image.tobytes())
            self.calibrations.append(message.calibration)
        if self.answering:
            self.answer(received.header)

    def answer(self, header: Header) -> None:
        """Publish the matches of all frames up to this one, and that they are answered."""
        if not header.live:
            for sequence in range(header.sequence + (not header.end)):
                self.match(header.of_frame(sequence))
        self.acknowledge(header)

    def match(self, header: Header) -> None:
        """Publish the match of a frame, once."""
        frame = header.stream, header.sequence
        if frame not in self._matched:
            self._matched.add(frame)
            self._matches.put(header, MatchMessage(map=NO_DIGEST, place=0, score=1.0))

    def acknowledge(self, header: Header) -> None:
        self._acks.put(header)

    @property
    def odometry(self) -> list[float | None]:
        """Of each frame, once: on a busy machine the source may send one again."""
        return list(self._odometry.values())

    @property
    def sequences(self) -> list[int]:
        return [header.sequence for header in self.headers if not header.end]


@pytest.fixture
def services(router: Bus, config: Config) -> Iterator[Services]:
    with open_bus(config.bus) as bus:
        yield Services(bus)


@pytest.fixture
def bus(router: Bus, config: Config) -> Iterator[Bus]:
    with open_bus(config.bus) as bus:
        yield bus


@contextmanager
def in_background(source: Source, bus: Bus, config: Config) -> Iterator[threading.Event]:
    """Replay beside the block; it is stopped at the end of it."""
    stop = threading.Event()
    thread = threading.Thread(target=replay, args=(source, bus, config, stop))
    thread.start()
    try:
        yield stop
    finally:
        stop.set()
        thread.join()


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "in vain"
        time.sleep(0.01)


def wait_for(services: Services, frames: int) -> None:
    wait_until(lambda: len(services.sequences) >= frames)


class MadeUp(Source):
    """So many frames of pixels; fails at the end if told to."""

    def __init__(self, count: int, *, fails: bool = False) -> None:
        self.count = count
        self._fails = fails

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self.count or 0):
            pixels = np.full((8, 8), index, np.uint8)
            yield Frame(index, 1000 + index, f"frame {index}", pixels)
        if self._fails:
            raise SourceError("made-up: gone")


class LiveMadeUp(MadeUp):
    live = True


def test_every_frame_is_sent_once_in_order_with_the_end_behind(
    services: Services, bus: Bus, config: Config, query_dir: Path
) -> None:
    with open_source(str(query_dir)) as source:
        assert replay(source, bus, config, threading.Event()).sent == 60
    assert services.images == [file.read_bytes() for file in sorted(query_dir.iterdir())]
    assert services.sequences == list(range(60))
    assert services.headers[-1].end
    assert services.headers[-1].sequence == 60
    assert len({header.stream for header in services.headers}) == 1
    assert not any(header.live for header in services.headers)


def test_start_and_stride_choose_the_frames_but_numbers_have_no_gaps(
    services: Services, bus: Bus, config: Config, query_dir: Path
) -> None:
    with open_source(str(query_dir), parts=Parts(start=10, stride=7)) as source:
        assert replay(source, bus, config, threading.Event()).sent == 8
    files = sorted(query_dir.iterdir())[10::7]
    assert services.images == [file.read_bytes() for file in files]
    assert services.sequences == list(range(8))


def test_an_uneven_drive_is_sent_as_the_even_one_when_it_is_spaced(
    services: Services, bus: Bus, config: Config, query_dir: Path, tmp_path: Path
) -> None:
    uneven = uneven_drive(query_dir, tmp_path / "uneven")
    with open_source(str(uneven), spacing_m=0.1) as source:
        assert replay(source, bus, config, threading.Event()).sent == 60
    assert services.images == [file.read_bytes() for file in sorted(query_dir.iterdir())]
    assert services.sequences == list(range(60))


def test_each_frame_carries_its_stamp(services: Services, bus: Bus, config: Config) -> None:
    replay(MadeUp(5), bus, config, threading.Event())
    assert [header.stamp_ns for header in services.headers[:5]] == list(range(1000, 1005))


def test_each_frame_carries_the_calibration_of_its_camera(
    services: Services, bus: Bus, config: Config, query_dir: Path, tmp_path: Path
) -> None:
    lens = pinhole(96, 72, 60)
    camera = lens.write(tmp_path / "camera.yaml")
    with open_source(str(query_dir), parts=Parts(stop=5, camera=camera)) as source:
        replay(source, bus, config, threading.Event())
    assert set(services.calibrations) == {lens.calibration}


def test_each_frame_carries_its_odometry_where_it_is_known(
    services: Services, bus: Bus, config: Config, query_dir: Path, tmp_path: Path
) -> None:
    drive = uneven_drive(query_dir, tmp_path / "uneven")
    with open_source(str(drive), parts=Parts(start=1, stride=3)) as source:
        expected = [frame.odometry_m for frame in source]
        replay(source, bus, config, threading.Event())
    assert services.odometry == expected
    assert len({*expected}) > 20
    replay(MadeUp(3), bus, config, threading.Event())
    assert services.odometry[len(expected) :] == [None] * 3


def test_no_more_frames_are_under_way_than_there_are_credits(
    services: Services, bus: Bus, config: Config
) -> None:
    services.answering = False
    with in_background(MadeUp(3 * WINDOW), bus, config):
        wait_for(services, WINDOW)
        time.sleep(0.3)
        assert services.sequences == list(range(WINDOW))
        services.answer(services.headers[4])  # stands for all before it
        wait_for(services, WINDOW + 5)
        time.sleep(0.3)
        assert services.sequences == list(range(WINDOW + 5))


def test_what_is_not_answered_is_sent_again_from_the_oldest_on(
    services: Services, bus: Bus, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sending, "_SEND_AGAIN_S", 1.0)
    clock = Clock()
    monkeypatch.setattr(sending, "time", clock)
    services.answering = False
    with in_background(MadeUp(3 * WINDOW), bus, config):
        wait_for(services, WINDOW)
        clock.now += 1
        wait_for(services, 2 * WINDOW)
        assert services.sequences == 2 * list(range(WINDOW))
        assert services.images[:WINDOW] == services.images[WINDOW:]
        services.answer(services.headers[4])
        wait_for(services, 2 * WINDOW + 5)
        clock.now += 1
        wait_for(services, 3 * WINDOW + 5)
    again = [header for header in services.headers if not header.end][2 * WINDOW + 5 :]
    assert [header.sequence for header in again] == list(range(5, WINDOW + 5))
    assert {header.oldest for header in again} == {5}


def test_what_was_under_way_when_a_service_died_is_sent_again_when_it_is_back(
    router: Bus, bus: Bus, config: Config
) -> None:
    with ExitStack() as stack:
        first = Services(stack.enter_context(open_bus(config.bus)), answering=False)
        with in_background(MadeUp(3 * WINDOW), bus, config):
            wait_for(first, WINDOW)
            time.sleep(0.2)
            assert first.sequences == list(range(WINDOW))
            stack.pop_all().close()
            time.sleep(0.2)
            with open_bus(config.bus) as again:
                second = Services(again)
                wait_for(second, 3 * WINDOW)
    assert second.sequences == list(range(3 * WINDOW))


def test_answers_to_another_stream_give_no_credit(
    services: Services, bus: Bus, config: Config
) -> None:
    services.answering = False
    with in_background(MadeUp(3 * WINDOW), bus, config):
        wait_for(services, WINDOW)
        services.answer(services.headers[-1].model_copy(update={"stream": "another"}))
        time.sleep(0.3)
        assert len(services.sequences) == WINDOW


@pytest.mark.parametrize("beyond", [0, 1, 2**40])
def test_an_answer_to_what_was_not_sent_gives_no_credit_and_ends_nothing(
    router: Bus, bus: Bus, config: Config, beyond: int
) -> None:
    with open_bus(config.bus) as apart:
        services = Services(apart, answering=False)
        with in_background(MadeUp(2 * WINDOW), bus, config):
            wait_for(services, WINDOW)
            last = services.headers[-1]
            services.acknowledge(last.model_copy(update={"sequence": WINDOW + beyond, "oldest": 0}))
            time.sleep(0.5)
            assert {*services.sequences} == {*range(WINDOW)}
            services.answer(services.headers[0])
            wait_until(lambda: WINDOW in services.sequences)


@pytest.mark.parametrize("place", [0, 1, WINDOW // 2, WINDOW - 1])
def test_an_answer_to_a_frame_whose_match_has_not_come_gives_no_credit(
    router: Bus,
    bus: Bus,
    config: Config,
    place: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    with open_bus(config.bus) as apart:
        services = Services(apart, answering=False)
        with in_background(MadeUp(2 * WINDOW), bus, config):
            wait_for(services, WINDOW)
            if place:  # all but one before it
                services.match(services.headers[0].of_frame(place))
                for sequence in range(place - 1):
                    services.match(services.headers[0].of_frame(sequence))
            services.acknowledge(services.headers[place])
            time.sleep(0.5)
            assert {*services.sequences} == {*range(WINDOW)}
            services.answering = True
            services.answer(services.headers[WINDOW - 1])
            wait_for_end(services)
    assert {*services.sequences} == {*range(2 * WINDOW)}
    assert any("answers or matches were not due" in each for each in caplog.messages), caplog.text


@pytest.mark.parametrize("end", [False, True])
def test_a_replay_ends_when_every_match_has_come_whatever_is_acknowledged(
    router: Bus, bus: Bus, config: Config, end: bool
) -> None:
    with open_bus(config.bus) as apart:
        services = Services(apart, answering=False)
        thread = threading.Thread(target=replay, args=(MadeUp(3), bus, config, threading.Event()))
        thread.start()
        wait_for_end(services)
        services.acknowledge(services.headers[3].model_copy(update={"end": end}))
        services.match(services.headers[0].of_frame(1))
        services.acknowledge(services.headers[3])
        thread.join(0.5)
        assert thread.is_alive()
        services.answer(services.headers[3])
        thread.join()


def wait_for_end(services: Services) -> None:
    wait_until(lambda: any(header.end for header in services.headers))


def test_a_live_source_waits_for_no_credit(services: Services, bus: Bus, config: Config) -> None:
    services.answering = False
    with in_background(LiveMadeUp(3 * WINDOW), bus, config):
        wait_for(services, 3 * WINDOW)
    assert all(header.live for header in services.headers)


def test_a_live_source_is_stopped_too(services: Services, bus: Bus, config: Config) -> None:
    stop = threading.Event()
    stop.set()
    assert replay(LiveMadeUp(10**9), bus, config, stop).sent == 0


def test_a_loop_goes_on_in_the_same_stream_until_it_is_stopped(
    services: Services, bus: Bus, config: Config
) -> None:
    stop = threading.Event()

    def stop_after_35() -> None:
        wait_for(services, 35)
        stop.set()

    threading.Thread(target=stop_after_35).start()
    sent = replay(MadeUp(10), bus, config, stop, loop=True).sent
    assert sent >= 35
    wait_for(services, sent)
    assert services.sequences == list(range(sent))
    assert [image[0] for image in services.images] == [s % 10 for s in range(sent)]
    assert len({header.stream for header in services.headers}) == 1


def test_a_replay_that_is_stopped_ends_its_stream(
    services: Services, bus: Bus, config: Config
) -> None:
    services.answering = False
    with in_background(MadeUp(3 * WINDOW), bus, config):
        wait_for(services, WINDOW)
    wait_until(lambda: services.headers[-1].end)
    assert services.headers[-1].sequence == WINDOW


def test_at_a_rate_frames_keep_their_distance(services: Services, bus: Bus, config: Config) -> None:
    began = time.monotonic()
    replay(MadeUp(11), bus, config, threading.Event(), rate=20)
    assert time.monotonic() - began >= 10 / 20  # a sleep is never short, however busy the machine


class Clock:
    """Time that passes when told to."""

    sleep = staticmethod(time.sleep)

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


def test_at_a_rate_a_camera_gives_its_newest_frames_not_a_queue_of_old_ones(
    services: Services, bus: Bus, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(replaying, "time", clock)

    class Camera(LiveMadeUp):
        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                yield frame
                clock.now += 0.04

    said = iter([None, 1.0, *[None] * 10, 2.0, 3.0, *[None] * 100])
    camera = WithOdometry(Camera(100), lambda: next(said))
    replay(camera, bus, config, threading.Event(), rate=4.9)
    assert [image[0] for image in services.images[:5]] == [0, 6, 11, 16, 21]
    assert services.odometry[:5] == [None, 1.0, None, 3.0, None]
    assert services.sequences == list(range(len(services.images)))


def test_at_a_low_rate_what_is_lost_is_sent_again_before_the_next_frame_is_due(
    services: Services, bus: Bus, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sending, "_SEND_AGAIN_S", 0.1)
    services.answering = False
    stop = threading.Event()
    arguments = {"rate": 0.001}
    thread = threading.Thread(target=replay, args=(MadeUp(3), bus, config, stop), kwargs=arguments)
    thread.start()
    wait_for(services, 3)
    stop.set()
    thread.join()
    assert set(services.sequences) == {0}


def test_a_source_that_is_slow_to_give_a_frame_does_not_count_as_silent_services(
    services: Services, bus: Bus, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sending, "_SEND_AGAIN_S", 0.5)
    monkeypatch.setattr(sending, "_STALLED_S", 1.0)
    clock = Clock()
    monkeypatch.setattr(sending, "time", clock)

    class Slow(MadeUp):
        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                yield frame
                wait_for(services, frame.index + 1)
                clock.now += 1000.0
                services.answering = True

    services.answering = False  # the first is lost
    assert replay(Slow(3), bus, config, threading.Event()).sent == 3
    assert services.sequences.count(0) > 1
    assert {*services.sequences} == {0, 1, 2}


def test_a_source_that_is_cut_short_before_its_first_frame_has_not_failed(
    services: Services, bus: Bus, config: Config
) -> None:
    stop = threading.Event()
    stop.set()
    assert replay(MadeUp(0, fails=True), bus, config, stop).sent == 0


@pytest.mark.parametrize(
    ("source", "sent"), [(MadeUp(3 * WINDOW), WINDOW), (MadeUp(5), 5), (LiveMadeUp(40), 40)]
)
def test_services_that_stop_answering_end_the_replay_with_a_word(
    services: Services,
    bus: Bus,
    config: Config,
    monkeypatch: pytest.MonkeyPatch,
    source: Source,
    sent: int,
) -> None:
    monkeypatch.setattr(sending, "_STALLED_S", 1.0)
    services.answering = False
    with pytest.raises(BusError, match=rf"'test': {sent} frames sent, 0 answered.*status"):
        replay(source, bus, config, threading.Event())


def test_without_services_it_says_which_are_missing(router: Bus, bus: Bus, endpoint: str) -> None:
    config = Config(runs=("test",), bus=BusConfig(endpoint=endpoint, connect_timeout_s=0.5))
    with pytest.raises(BusError, match=r"no featurizer and no fuser.*placefield up MAP"):
        replay(MadeUp(5), bus, config, threading.Event())
    with open_bus(config.bus) as other:
        other.declare_alive(KEYS.alive("featurizer", "stand-in"))
        wait_until(lambda: bool(bus.alive(KEYS.all_alive("featurizer"))))
        with pytest.raises(BusError, match="'test' has no fuser:"):
            replay(MadeUp(5), bus, config, threading.Event())


def test_a_second_replay_on_a_run_is_refused_while_the_first_is_on(
    services: Services, bus: Bus, config: Config
) -> None:
    services.answering = False
    with open_bus(config.bus) as other, in_background(MadeUp(3 * WINDOW), bus, config):
        wait_for(services, WINDOW)
        with pytest.raises(BusError, match=r"has a replay already.*--run"):
            replay(MadeUp(5), other, config, threading.Event())


def test_a_source_that_fails_on_the_way_says_so_and_its_stream_ends(
    services: Services, bus: Bus, config: Config
) -> None:
    with pytest.raises(SourceError, match="made-up: gone"):
        replay(MadeUp(5, fails=True), bus, config, threading.Event())
    assert [header.end for header in services.headers] == [False] * 5 + [True]
