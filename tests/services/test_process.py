import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable

import pytest
from bus_doubles import header, received

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import Message, StatsMessage
from placefield.bus.session import Bus
from placefield.errors import MessageError
from placefield_services.process import SUPERVISED, ServiceProcess

KEYS = Keys("test")


class QuietBus(Bus):
    """A bus with nobody on it but one process."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Message]] = []
        self.dropped: list[str] = []

    def put(self, key: str, message: Message) -> None:
        self.published.append((key, message))

    def log_dropped(self, key: str, error: Exception) -> None:
        self.dropped.append(str(error))


def serve(
    process: ServiceProcess,
    handle: Callable[[Received], None],
    messages: int,
    idle: Callable[[], None] = lambda: None,
) -> None:
    """Let a process serve so many messages, and then stop."""
    inbox, stop = Inbox(Counter()), threading.Event()
    for sequence in range(messages):
        inbox.offer(received(KEYS.frame, header(sequence)))

    def handle_and_stop(message: Received) -> None:
        if message.header.sequence == messages - 1:
            stop.set()
        handle(message)

    process.serve(inbox, handle_and_stop, stop, idle=idle)


@pytest.fixture
def bus() -> QuietBus:
    return QuietBus()


@pytest.fixture
def process(bus: QuietBus) -> ServiceProcess:
    return ServiceProcess("fuser", bus, KEYS)


def test_messages_that_do_not_parse_or_fail_stop_nothing_and_are_counted(
    bus: QuietBus, process: ServiceProcess
) -> None:
    handled = []

    def handle(message: Received) -> None:
        handled.append(message.header.sequence)
        if message.header.sequence == 1:
            raise MessageError("no msgpack")
        if message.header.sequence == 2:
            raise ZeroDivisionError

    serve(process, handle, 5)
    assert handled == [0, 1, 2, 3, 4]
    assert process.counts == {"received": 5, "malformed": 1, "failed": 1}
    assert bus.dropped == ["no msgpack"]


def test_what_is_done_between_messages_may_fail_too(process: ServiceProcess) -> None:
    def idle() -> None:
        raise ZeroDivisionError

    serve(process, lambda _: None, 3, idle)
    assert process.counts == {"received": 3, "failed": 3}


def test_counts_are_published_under_the_process_own_name(
    bus: QuietBus, process: ServiceProcess
) -> None:
    serve(process, lambda _: None, 1)
    stats = StatsMessage(service="fuser", counts={"received": 1})
    assert bus.published == [(KEYS.stats("fuser", process.identity), stats)]


_WAITS_FOR_STOP = """
from placefield_services.process import stop_event
stop = stop_event()
print("ready", flush=True)
raise SystemExit(0 if stop.wait(30) else 3)
"""


def start(**environment: str) -> "subprocess.Popen[str]":
    waiting = subprocess.Popen(
        [sys.executable, "-c", _WAITS_FOR_STOP],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert waiting.stdout is not None
    assert waiting.stdout.readline() == "ready\n"
    return waiting


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_a_process(number: signal.Signals) -> None:
    with start() as waiting:
        waiting.send_signal(number)
        assert waiting.wait(20) == 0


def test_a_supervised_process_stops_when_its_host_is_gone() -> None:
    with start(**{SUPERVISED: "1"}) as waiting:
        assert waiting.stdin is not None
        waiting.stdin.close()
        assert waiting.wait(20) == 0


def test_any_other_process_does_not_mind_the_end_of_its_input() -> None:
    with start() as waiting:
        assert waiting.stdin is not None
        waiting.stdin.close()
        with pytest.raises(subprocess.TimeoutExpired):
            waiting.wait(0.3)
        waiting.terminate()
        assert waiting.wait(20) == 0
