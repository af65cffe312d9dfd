import gc
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence

import pytest
from bus_doubles import header, received

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.message import Message
from placefield.bus.messages import StatsMessage
from placefield.bus.publishing import Outbox
from placefield.bus.replay_cache import ReplayCache
from placefield.bus.session import Bus
from placefield.errors import MessageError
from placefield_services.background_query import NotYet
from placefield_services.child_environment import SUPERVISED
from placefield_services.process import AT_ONCE, ServiceProcess, begin

KEYS = Keys("test")


class QuietBus(Bus):
    """A bus with only one process."""

    def __init__(self) -> None:
        self.outbox = Outbox()
        self.published: list[tuple[str, Message]] = []
        self.dropped: list[str] = []

    def put(self, key: str, message: Message) -> None:
        self.published.append((key, message))

    def log_dropped(self, key: str, error: Exception) -> None:
        self.dropped.append(str(error))


def serve(
    process: ServiceProcess,
    accept: Callable[[Received], int | None],
    messages: Sequence[Received],
    work: Callable[[Sequence[int]], None] = lambda accepted: None,
    after_batch: Callable[[str], None] = lambda run: None,
) -> None:
    """Let a process serve these messages, and then stop."""
    inbox, stop = Inbox(process.counts), threading.Event()
    for message in messages:
        inbox.offer(message)

    def accept_and_stop(message: Received) -> int | None:
        if message is messages[-1]:
            stop.set()
        return accept(message)

    process.serve(inbox, accept_and_stop, stop, work=work, after_batch=after_batch)


def messages_of(count: int, run: str = "test") -> list[Received]:
    return [received(Keys(run).frame, header(sequence)) for sequence in range(count)]


def sequence_of(message: Received) -> int:
    return message.header.sequence


@pytest.fixture
def bus() -> QuietBus:
    return QuietBus()


@pytest.fixture
def process(bus: QuietBus) -> ServiceProcess:
    return ServiceProcess("fuser", bus, ["test", "other"])


def test_a_message_that_cannot_be_handled_yet_delays_only_its_run(
    process: ServiceProcess,
) -> None:
    accepted: list[tuple[str, int]] = []

    def accept(message: Received) -> None:
        is_other_through = ("other", 3) in accepted
        if message.run == "test" and sequence_of(message) == 1 and not is_other_through:
            raise NotYet(0.001)
        accepted.append((message.run, sequence_of(message)))

    ours, others = messages_of(4), messages_of(4, "other")
    last = ours.pop()
    serve(process, accept, [*ours, *others, last])
    assert [sequence for run, sequence in accepted if run == "test"] == [0, 1, 2, 3]
    assert [sequence for run, sequence in accepted if run == "other"] == [0, 1, 2, 3]
    assert process.counts == {"test": {"received": 4}, "other": {"received": 4}}


def test_answers_wait_in_the_outbox_while_messages_wait_in_the_inbox(
    bus: QuietBus, process: ServiceProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    handled, sent_after = 0, []

    def accept(message: Received) -> None:
        nonlocal handled
        handled += 1

    monkeypatch.setattr(bus.outbox, "send_all", lambda: sent_after.append(handled))
    monkeypatch.setattr(Outbox, "is_due", False)
    serve(process, accept, messages_of(2 * AT_ONCE))
    assert sent_after == [2 * AT_ONCE]


def test_an_answer_that_cannot_be_sent_stops_nothing_and_is_counted(
    bus: QuietBus, process: ServiceProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(bus.outbox, "send_all", fail)
    serve(process, lambda message: None, messages_of(1))
    assert process.counts["test"] == {"received": 1, "failed": 1}


def test_messages_that_do_not_parse_or_fail_stop_nothing_and_are_counted(
    bus: QuietBus, process: ServiceProcess
) -> None:
    worked: list[int] = []

    def accept(message: Received) -> int | None:
        if sequence_of(message) == 1:
            raise MessageError("no msgpack")
        if sequence_of(message) == 2:
            raise ZeroDivisionError
        return None if sequence_of(message) == 3 else sequence_of(message)

    serve(process, accept, messages_of(6), worked.extend)
    assert worked == [0, 4, 5]
    assert process.counts == {"test": {"received": 6, "malformed": 1, "failed": 1}, "other": {}}
    assert bus.dropped == ["no msgpack"]


def test_every_message_of_work_that_fails_is_counted_in_its_run(process: ServiceProcess) -> None:
    batches: list[list[int]] = []

    def work(accepted: Sequence[int]) -> None:
        batches.append([*accepted])
        if len(batches) == 1:
            raise ZeroDivisionError

    more = AT_ONCE + 2
    serve(process, sequence_of, [*messages_of(3, "other"), *messages_of(more)], work)
    assert [len(batch) for batch in batches] == [AT_ONCE, 5]
    assert process.counts == {
        "test": {"received": more, "failed": AT_ONCE - 3},
        "other": {"received": 3, "failed": 3},
    }


def test_a_run_that_does_not_smooth_keeps_no_other_from_it(process: ServiceProcess) -> None:
    smoothed = []

    def after_batch(run: str) -> None:
        if run == "test":
            raise ZeroDivisionError
        smoothed.append(run)

    serve(process, sequence_of, messages_of(3), after_batch=after_batch)
    assert smoothed == ["other"]
    assert process.counts == {"test": {"received": 3, "failed": 1}, "other": {}}


def test_counts_are_published_by_run_under_the_process_own_name(
    bus: QuietBus, process: ServiceProcess
) -> None:
    serve(process, sequence_of, messages_of(1))
    own, other = (
        StatsMessage(service="fuser", counts={"received": 1}),
        StatsMessage(service="fuser", counts={}),
    )
    assert bus.published == [
        (KEYS.stats("fuser", process.identity), own),
        (Keys("other").stats("fuser", process.identity), other),
    ]


def test_the_newest_answer_of_each_run_and_the_channels_are_reported(
    bus: QuietBus, process: ServiceProcess
) -> None:
    answers = ReplayCache()
    process.answers["test"], process.answers["other"] = answers, ReplayCache()
    process.channels = 3
    answers.store(header(41), b"an answer")
    serve(process, sequence_of, messages_of(1))
    stats = dict(bus.published)
    assert stats[KEYS.stats("fuser", process.identity)] == StatsMessage(
        service="fuser", counts={"received": 1}, stream="s", sequence=41, channels=3
    )
    assert stats[Keys("other").stats("fuser", process.identity)] == StatsMessage(
        service="fuser", counts={}, channels=3
    )


def test_garbage_collection_is_off_until_a_process_serves(process: ServiceProcess) -> None:
    looked_for = []
    try:
        begin()
        looked_for.append(gc.isenabled())
        serve(process, lambda _: looked_for.append(gc.isenabled()), messages_of(1))
    finally:
        gc.enable()
        gc.unfreeze()
    assert looked_for == [False, True]


_WAITS_FOR_STOP = """
from placefield_services.process import stop_event
stop = stop_event()
print("ready", flush=True)
raise SystemExit(0 if stop.wait(60) else 3)
"""


_STARTS_FOR_LONG = """
import time
from placefield_services.process import stop_of_service
stop = stop_of_service()
print("ready", flush=True)
time.sleep(60)
raise SystemExit(3)
"""


def start(script: str = _WAITS_FOR_STOP, **environment: str) -> "subprocess.Popen[str]":
    waiting = subprocess.Popen(
        [sys.executable, "-c", script],
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
        assert waiting.wait(60) == 0


def test_a_service_that_is_still_starting_ends_when_it_is_asked_to() -> None:
    with start(_STARTS_FOR_LONG) as starting:
        starting.terminate()
        assert starting.wait(60) == 0


def test_a_supervised_process_stops_when_its_host_is_gone() -> None:
    with start(**{SUPERVISED: "1"}) as waiting:
        assert waiting.stdin is not None
        waiting.stdin.close()
        assert waiting.wait(60) == 0


def test_an_unsupervised_process_survives_the_end_of_its_input() -> None:
    with start() as waiting:
        assert waiting.stdin is not None
        waiting.stdin.close()
        with pytest.raises(subprocess.TimeoutExpired):
            waiting.wait(0.3)
        waiting.terminate()
        assert waiting.wait(60) == 0


WAITING = """
from placefield_services.process import leave, stop_event

for _ in range(2000):
    stop = stop_event()
    print("waiting", flush=True)
    while not stop.wait(1e-6):
        pass
leave()
"""


def test_a_signal_ends_the_wait_whatever_it_interrupts() -> None:
    with subprocess.Popen([sys.executable, "-c", WAITING], stdout=subprocess.PIPE) as process:
        too_late = threading.Timer(30, process.kill)
        too_late.start()
        assert process.stdout is not None
        while process.stdout.readline():
            time.sleep(random.uniform(0, 5e-4))
            process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
        too_late.cancel()
