"""Sources that are disturbed, and children that are started again, with no process and no wait."""

import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import cast

from placefield_tools.chaos.children import Children
from placefield_tools.chaos.faulty_source import FaultySource
from placefield_tools.chaos.schedule import Fault
from placefield_tools.chaos.verdict import Happened
from placefield_tools.sources import open_source


class SetClock:
    """Shows the time that it is set to."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_a_fault_happens_at_its_frames_turn_and_ends_at_its_ends(query_dir: Path) -> None:
    clock, calls = SetClock(), list[tuple[str, int, int]]()
    stopped, killed = Fault("stop channel", 2, 5, 0), Fault("kill router", 62, 62, 0)
    read = 0
    faulty = FaultySource(
        open_source(str(query_dir)),
        64,
        [stopped, killed],
        lambda fault: calls.append(("begin", fault.at, read)),
        lambda fault: calls.append(("end", fault.at, read)),
        clock,
    )
    images = []
    for frame in faulty:
        images.append(frame.image)
        read += 1
        clock.now += 0.5
    assert calls == [("begin", 2, 2), ("end", 2, 5), ("begin", 62, 62)]
    assert faulty.happened == [Happened(stopped, 2, 1.0), Happened(killed, 62, 31.0)]
    files = [file.read_bytes() for file in sorted(query_dir.iterdir())]
    assert images == (files + files)[:64]


class FakeProcess:
    """Dies when it is killed; no other signal does anything."""

    stdin = None

    def __init__(self, command: Sequence[str]) -> None:
        self.command = command
        self.signals: list[int] = []

    def poll(self) -> int | None:
        return -9 if signal.SIGKILL in self.signals else None

    def send_signal(self, number: signal.Signals) -> None:
        self.signals.append(number)

    def terminate(self) -> None:
        self.signals.append(signal.SIGTERM)

    def wait(self, timeout: float | None = None) -> int:
        return 0


def test_a_killed_service_is_started_again_and_a_dead_one_gets_no_signal() -> None:
    clock, started = SetClock(), list[FakeProcess]()

    def start(command: Sequence[str]) -> "subprocess.Popen[bytes]":
        started.append(FakeProcess(command))
        return cast("subprocess.Popen[bytes]", started[-1])

    commands = {"router": ["r"], "channel 0": ["c", "0"], "channel 1": ["c", "1"]}
    children = Children(commands, clock, start)
    children.start()
    assert children.names("channel") == ["channel 0", "channel 1"]
    assert [process.command for process in started] == [["r"], ["c", "0"], ["c", "1"]]
    children.signal("channel 1", signal.SIGKILL)
    children.keep_running()
    children.signal("channel 1", signal.SIGSTOP)
    clock.now = 0.4
    children.keep_running()
    assert len(started) == 3
    clock.now = 0.6
    children.keep_running()
    assert started[3].command == ["c", "1"]
    children.signal("channel 1", signal.SIGSTOP)
    assert [process.signals for process in started] == [[], [], [9], [19]]
    children.stop()
    assert started[3].signals == [19, 18, 15]
