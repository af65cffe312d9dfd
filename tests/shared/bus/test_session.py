"""Routers and clients in one process, on free ports of loopback."""

import queue
import time
from collections import Counter
from collections.abc import Callable, Iterator

import pytest
import zenoh

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, FrameMessage, StatsMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.errors import BusError, MessageError

KEYS = Keys("test")
END = Header(stream="s", sequence=0, stamp_ns=0, end=True)


def header(sequence: int) -> Header:
    return Header(stream="s", sequence=sequence, stamp_ns=-sequence)


@pytest.fixture
def config(endpoint: str) -> BusConfig:
    return BusConfig(endpoint=endpoint, connect_timeout_s=60)


@pytest.fixture
def router(config: BusConfig) -> Iterator[Bus]:
    with open_router(config) as bus:
        yield bus


@pytest.fixture
def sender(router: Bus, config: BusConfig) -> Iterator[Bus]:
    with open_bus(config) as bus:
        yield bus


@pytest.fixture
def receiver(router: Bus, config: BusConfig) -> Iterator[Bus]:
    with open_bus(config) as bus:
        yield bus


@pytest.fixture
def untrusted_client(router: Bus, config: BusConfig) -> Iterator[zenoh.Session]:
    """A Zenoh session that does not use our messages."""
    settings = zenoh.Config()
    settings.insert_json5("mode", '"client"')
    settings.insert_json5("connect/endpoints", f'["{config.endpoint}"]')
    settings.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(settings) as session:
        yield session


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "in vain"
        time.sleep(0.01)


def subscribe(bus: Bus, key: str, counts: Counter[str]) -> "queue.SimpleQueue[Received]":
    received: queue.SimpleQueue[Received] = queue.SimpleQueue()
    bus.subscribe(key, received.put, counts)
    bus.declare_alive(KEYS.alive("test", "reader"))
    return received


def await_reader(bus: Bus) -> None:
    """Wait for the token that a reader declares after it has subscribed."""
    wait_until(lambda: bool(bus.alive(KEYS.all_alive("test"))))


def test_messages_arrive_whole_in_order_and_none_is_lost(sender: Bus, receiver: Bus) -> None:
    counts: Counter[str] = Counter()
    received = subscribe(receiver, KEYS.frame, counts)
    await_reader(sender)
    publisher = sender.publisher(KEYS.frame)
    images = [bytes([sequence % 256]) * (sequence * 37) for sequence in range(1000)]
    for sequence, image in enumerate(images):
        publisher.put(header(sequence), FrameMessage(image=image))
    publisher.put(END)
    for sequence, image in enumerate(images):
        message = received.get(timeout=60)
        assert message.key == KEYS.frame
        assert message.header == header(sequence)
        assert FrameMessage.decode(message.payload).image == image
    last = received.get(timeout=60)
    assert last.header == END
    assert last.payload == b""
    assert not counts


def test_messages_that_travel_together_are_received_one_by_one(sender: Bus, receiver: Bus) -> None:
    counts: Counter[str] = Counter()
    received = subscribe(receiver, KEYS.feature, counts)
    await_reader(sender)
    features = sender.gathering_publisher(KEYS.feature)
    sender.outbox.begin()
    for sequence in range(3):
        features.put(header(sequence), FeatureMessage(model=str(sequence), descriptor=None))
    features.send(END, b"not empty")
    features.put(header(4))
    sender.outbox.send_all()
    came = [received.get(timeout=60) for _ in range(4)]
    assert [message.header.sequence for message in came] == [0, 1, 2, 4]
    models = [FeatureMessage.decode(message.payload).model for message in came[:3]]
    assert models == ["0", "1", "2"]
    assert counts == {"malformed": 1}


def test_runs_do_not_receive_messages_of_each_other(sender: Bus, receiver: Bus) -> None:
    received = subscribe(receiver, KEYS.feature, Counter())
    await_reader(sender)
    sender.publisher(Keys("other").feature).put(END)
    sender.publisher(KEYS.feature).put(header(7), FeatureMessage(model="m", descriptor=None))
    assert received.get(timeout=60).header == header(7)


def test_a_message_without_a_valid_header_is_counted_and_the_next_one_still_comes(
    sender: Bus, receiver: Bus, untrusted_client: zenoh.Session
) -> None:
    counts: Counter[str] = Counter()
    received = subscribe(receiver, KEYS.frame, counts)
    await_reader(sender)
    good = header(0).encode()
    garbage = [None, b"", b"\xc1", b"\x00" * 1000, good[:-1], good + b"\0", b"\x91" * 5000]
    garbage.append(END.encode())  # has no payload
    garbage.append(b"\x92" + good + good)  # a bundle without a list of payloads
    for attachment in garbage:
        untrusted_client.put(KEYS.frame, b"payload", attachment=attachment)
    untrusted_client.delete(KEYS.frame)
    wait_until(lambda: counts["malformed"] == len(garbage) + 1)
    sender.publisher(KEYS.frame).put(header(1), FrameMessage(image=b""))
    assert received.get(timeout=60).header == header(1)
    assert received.empty()


@pytest.mark.parametrize("key", ["placefield/*/frame", "placefield/**", "placefield/t$*/frame"])
def test_a_message_on_many_keys_at_once_is_counted_and_the_next_one_still_comes(
    untrusted_client: zenoh.Session, sender: Bus, receiver: Bus, key: str
) -> None:
    counts: Counter[str] = Counter()
    received = subscribe(receiver, KEYS.frame, counts)
    await_reader(sender)
    for _ in range(3):
        untrusted_client.put(key, b"x", attachment=header(0).encode())
    wait_until(lambda: counts["malformed"] == 3)
    sender.publisher(KEYS.frame).send(header(1), b"y")
    assert received.get(timeout=60).header.sequence == 1


def test_a_message_of_no_stream_arrives_as_bytes(sender: Bus, receiver: Bus) -> None:
    received: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    receiver.subscribe_raw(KEYS.all_stats, lambda key, payload: received.put((key, payload)))
    receiver.declare_alive(KEYS.alive("test", "reader"))
    await_reader(sender)
    stats = StatsMessage(service="fuser", counts={"matches": 3})
    sender.put(KEYS.stats("fuser", "ab12"), stats)
    key, payload = received.get(timeout=60)
    assert key == KEYS.stats("fuser", "ab12")
    assert StatsMessage.decode(payload) == stats


def test_a_token_lives_as_long_as_its_session(router: Bus, config: BusConfig) -> None:
    token = KEYS.alive("channel", "0-ab12")
    from_start: list[tuple[str, bool]] = []
    late: list[tuple[str, bool]] = []
    router.watch_alive(KEYS.all_alive(), lambda key, alive: from_start.append((key, alive)))
    with open_bus(config) as worker:
        worker.declare_alive(token)
        wait_until(lambda: from_start == [(token, True)])
        router.watch_alive(KEYS.all_alive(), lambda key, alive: late.append((key, alive)))
        wait_until(lambda: late == [(token, True)])
        assert router.alive(KEYS.all_alive("channel")) == {token}
        assert not router.alive(KEYS.all_alive("fuser"))
    wait_until(lambda: from_start == late == [(token, True), (token, False)])
    assert not router.alive(KEYS.all_alive())


def test_a_second_instance_of_a_sole_service_is_refused(sender: Bus, receiver: Bus) -> None:
    with sender.sole(KEYS, "fuser", "one"), receiver.sole(KEYS, "featurizer", "two"):
        with (
            pytest.raises(BusError, match=r"run 'test' has a fuser already.*--run"),
            receiver.sole(KEYS, "fuser", "three"),
        ):
            pytest.fail("the second was let in")
        wait_until(lambda: sender.alive(KEYS.all_alive("fuser")) == {KEYS.alive("fuser", "one")})
    wait_until(lambda: not sender.alive(KEYS.all_alive("fuser")))


def test_a_query_is_answered_by_each_session_that_has_an_answer_and_by_no_other(
    router: Bus, sender: Bus
) -> None:
    def refuse(key: str, payload: bytes) -> list[tuple[bytes, bytes]]:
        raise MessageError("of no use")

    router.answer("placefield/test/map/**", lambda key, asked: [(key.encode(), asked), (b"2", b"")])
    sender.answer("placefield/test/map/1", lambda key, asked: [(b"3", b"")])
    sender.answer("placefield/test/map/1", refuse)

    def replies() -> list[tuple[bytes, bytes]]:
        return sorted(sender.ask("placefield/test/map/1", b"which", timeout_s=10))

    wait_until(lambda: len(replies()) == 3)
    assert replies() == [(b"2", b""), (b"3", b""), (b"placefield/test/map/1", b"which")]
    assert list(sender.ask("placefield/test/other", timeout_s=10)) == []
