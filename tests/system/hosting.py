"""Real processes on free ports of loopback, and how they are ended whatever happens."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Self

import numpy as np
import psutil
from command_lines import Ended
from numpy.typing import NDArray

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys, service_and_identity
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage, StatsMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config, MatchingConfig, Rule
from placefield.errors import MessageError
from placefield.loading import ENV_PREFIX
from placefield.maps.map import Map
from placefield.recognizer import Recognizer
from placefield_tools.common.host_process import free_endpoint
from placefield_tools.listen.match_queue import MatchQueue

PLACEFIELD = (sys.executable, "-m", "placefield_tools")
PATIENCE_S = 60.0
"""However slow the machine, what has not happened by then does not happen."""

UNREADABLE = {0: 0, 25: 300, 26: 0}
"""Frames of the damaged query that cannot be read, and how many bytes are left of each."""

Answer = tuple[Header, MatchMessage]

_DEFAULT_RULE = MatchingConfig().rule


def wait_until(condition: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"in vain: {what}"
        time.sleep(0.02)


def environment(**settings: str) -> dict[str, str]:
    """Return this process's environment without its own settings, one BLAS thread each."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ENV_PREFIX)}
    return kept | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | settings


def placefield(
    *arguments: str | Path, cwd: Path | None = None, preexec: Callable[[], None] | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run a command to its end."""
    return subprocess.run(
        [*PLACEFIELD, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        cwd=cwd,
        env=environment(),
        preexec_fn=preexec,
        check=False,
    )


def refusal(ended: "subprocess.CompletedProcess[str]") -> str:
    """Return the one line in which a command says why it could not go on."""
    return Ended(ended.returncode, ended.stdout, ended.stderr).refusal


class Process:
    """A command that runs until it is stopped, with its output in files."""

    def __init__(
        self,
        folder: Path,
        *arguments: str | Path,
        cwd: Path | None = None,
        env: dict[str, str] | None = None,
    ) -> None:
        """Take a folder for its output, the command, and where and in what it runs."""
        name = f"{arguments[0]}-{time.monotonic_ns()}"
        self._cwd, self._env = cwd, env
        self._out, self._err = folder / f"{name}.out", folder / f"{name}.err"
        self._arguments = arguments
        self._family: set[psutil.Process] = set()
        self._helpers: set[psutil.Process] = set()  # of multiprocessing; they end after this one

    def __enter__(self) -> Self:
        with self._out.open("w") as out, self._err.open("w") as err:
            self._process = self._start(out, err)
        self.pid = self._process.pid
        return self

    def _start(self, out: IO[str], err: IO[str]) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [*PLACEFIELD, *map(str, self._arguments)],
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            cwd=self._cwd,
            env={**(self._env or environment()), "PYTHONFAULTHANDLER": "1"},  # see __exit__
        )

    @property
    def out(self) -> str:
        return self._out.read_text()

    @property
    def err(self) -> str:
        return self._err.read_text()

    @property
    def runs(self) -> bool:
        return self._process.poll() is None

    def children(self) -> list[psutil.Process]:
        """Return the processes of commands that this one has started and that live."""
        try:
            started = psutil.Process(self.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return []
        children = [child for child in started if "-m placefield_tools" in command_line(child)]
        self._family.update(children)
        self._helpers.update(set(started) - set(children))
        return children

    def left_behind(self) -> list[psutil.Process]:
        """Return all known child processes that are alive."""
        return [child for child in self._family if is_alive(child)]

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Hold the process still inside the block."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal; return the exit code."""
        self.children()
        self._process.send_signal(number)
        return self._process.wait(PATIENCE_S)

    def __exit__(self, *_: object) -> None:
        self.children()
        if self.runs:
            self._process.terminate()
        ends = True
        try:
            self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            ends = False
            self._process.send_signal(signal.SIGABRT)  # it writes where each thread is
            self._process.wait()
        left = self.left_behind()
        for child in left:
            child.kill()
        assert ends, f"it does not end on SIGTERM: {self._arguments}\n{self.err}"
        assert not left, f"left behind: {left}\n{self.err}"
        wait_until(lambda: not any(map(is_alive, self._helpers)), "the forkserver ends, too")


def is_alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def command_line(process: psutil.Process) -> str:
    """Return the command line of a process; an empty one if it has ended."""
    try:
        return " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        return ""


class Host(Process):
    """``placefield up``, ready."""

    def __init__(self, folder: Path, map_path: Path, *flags: str) -> None:
        self.endpoint = free_endpoint()
        super().__init__(folder, "up", map_path, "--endpoint", self.endpoint, *flags)

    def __enter__(self) -> Self:
        super().__enter__()
        try:
            wait_until(lambda: "\n" in self.out or not self.runs, "the host is ready")
            assert self.out.startswith("ready: "), self.err
        except BaseException:
            self.__exit__()
            raise
        return self

    def service(self, command: str, flag: str = "") -> list[psutil.Process]:
        """Return the living processes of a service whose command line holds a flag."""
        pattern = re.compile(rf"placefield_tools {command} .*{flag}")
        found = [child for child in self.children() if pattern.search(command_line(child))]
        return [child for child in found if is_alive(child)]

    def forkserver(self) -> psutil.Process:
        """Return the living process from which the services are forked."""
        started = psutil.Process(self.pid).children()
        (found,) = (child for child in started if "forkserver" in command_line(child))
        return found

    def replay(self, *arguments: str | Path) -> "subprocess.CompletedProcess[str]":
        replayed = placefield("replay", *arguments, "--endpoint", self.endpoint)
        assert replayed.returncode == 0, replayed.stderr
        return replayed

    @contextmanager
    def listener(self, run: str = "default") -> "Iterator[Listener]":
        with open_bus(BusConfig(endpoint=self.endpoint)) as bus:
            yield Listener(bus, run)


class Listener:
    """What a run publishes, from now on."""

    def __init__(self, bus: Bus, run: str = "default") -> None:
        self.bus = bus
        self.keys = Keys(run)
        self._matches = MatchQueue(bus, self.keys)
        self._smoothed = MatchQueue(bus, self.keys, smoothed=True)
        self._counts: dict[tuple[str, str], dict[str, int]] = {}
        bus.subscribe_raw(self.keys.all_stats, self._receive)

    def _receive(self, key: str, payload: bytes) -> None:
        try:
            self._counts[service_and_identity(key)] = StatsMessage.decode(payload).counts
        except MessageError:
            return

    def count(self, service: str, name: str) -> int:
        """Return what the processes of a service have counted together."""
        stats = dict(self._counts).items()
        return sum(counts.get(name, 0) for (of, _), counts in stats if of == service)

    def alive(self, service: str) -> set[str]:
        return self.bus.alive(self.keys.all_alive(service))

    def next_match(self) -> tuple[Header, MatchMessage | None]:
        """Return the next match; what is no match is left out."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            with suppress(MessageError):
                if (received := self._matches.get(0.1)) is not None:
                    return received
        raise AssertionError("no match came")

    def answers(
        self, first: int = 0, count: int | None = None, stream: str | None = None
    ) -> list[Answer]:
        """Return the next answers, of frames from ``first`` on: so many, or all of the stream.

        Answers to other streams than ``stream`` are left out, if it is given: a fuser answers what
        it owes to a stream that was cut off when the next one begins.
        """
        answers: list[Answer] = []
        while count is None or len(answers) < count:
            header, match = self.next_match()
            if stream not in (None, header.stream):
                continue
            due = first + len(answers)
            assert header.sequence == due, f"frame {due} is due, and this came: {header}"
            if match is None:
                assert count is None, "the stream ended too early"
                break
            answers.append((header, match))
        return answers

    def smoothed(self, stream: str) -> list[tuple[int, SmoothedMessage]]:
        """Return all smoothed matches of a stream, with the numbers of their frames."""
        smoothed: list[tuple[int, SmoothedMessage]] = []
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            received = self._smoothed.get(0.1)
            if received is None or received[0].stream != stream:
                continue
            if received[0].end:
                return smoothed
            if isinstance(received[1], SmoothedMessage):
                smoothed.append((received[0].sequence, received[1]))
        raise AssertionError("the smoothed matches have no end")

    def until_flagged(self, first: int) -> list[Answer]:
        """Return the next answers, of frames from ``first`` on, to the first with a flag."""
        answers = self.answers(first, count=1)
        while not answers[-1][1].missing:
            answers += self.answers(first + len(answers), count=1)
        return answers


def answers_of(stream: Sequence[Answer]) -> list[tuple[int, float, tuple[int, ...]]]:
    return [(match.place, match.score, match.missing) for _, match in stream]


def offline(
    placemap: Map, images: Sequence[Path | NDArray[np.uint8]], rule: Rule = _DEFAULT_RULE
) -> list[tuple[int, float, tuple[int, ...]]]:
    """Return what the recognizer says of the same frames, with no bus."""
    recognizer = Recognizer(placemap, Config(matching=MatchingConfig(rule=rule)))
    matches = [
        recognizer.update(image.read_bytes() if isinstance(image, Path) else image)
        for image in images
    ]
    return [(match.place, match.score, match.missing) for match in matches]


Smoothed = tuple[int, int, float | None, int, tuple[int, ...]]
"""Frame, place, probability, lag and missing channels of a smoothed match."""


def smoothed_of(stream: Sequence[tuple[int, SmoothedMessage]]) -> list[Smoothed]:
    return [(n, one.place, one.probability, one.lag, one.missing) for n, one in stream]


def smoothed_offline(
    placemap: Map, images: Sequence[Path], rule: Rule = _DEFAULT_RULE
) -> list[Smoothed]:
    """Return what the recognizer says of the same frames in hindsight."""
    recognizer = Recognizer(placemap, Config(matching=MatchingConfig(rule=rule)))
    for image in images:
        recognizer.update(image.read_bytes())
    smoothed = recognizer.smoothed() + recognizer.finish()
    matches = [(each.frame, each.match, each.lag) for each in smoothed]
    return [(n, one.place, one.probability, lag, one.missing) for n, one, lag in matches]
