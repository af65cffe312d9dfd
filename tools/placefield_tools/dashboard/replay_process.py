"""A replay that the page starts and stops: the command in a process of its own."""

import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path

from placefield.config import BusConfig
from placefield_services.host import child_environment
from placefield_tools.sources.secrets import without_secrets

_PATIENCE_S = 2.0
_OURS = "placefield: "
_LINES = 20


def replay_flags(run: str, bus: BusConfig) -> list[str]:
    """Return the flags that name a run and its bus.

    A dashboard's credentials do not let it publish; a camera's lie beside them.
    """
    flags = ["--run", run, "--endpoint", bus.endpoint]
    if bus.credentials:
        flags += ["--credentials", str(Path(bus.credentials).resolve().parent / "camera")]
    return flags


class ReplayChild:
    """One replay at a time, for all who look; it ends when this process does."""

    def __init__(self, flags: Sequence[str]) -> None:
        """Take the flags that name the run and the bus."""
        self._flags = flags
        self._source = ""
        self._process: subprocess.Popen[str] | None = None
        self._said: deque[str] = deque(maxlen=_LINES)
        self._hearing = threading.Thread()

    @property
    def runs(self) -> bool:
        """Whether it is on."""
        return self._process is not None and self._process.poll() is None

    def start(self, source: str, rate: float | None, *, loop: bool) -> None:
        """Start the replay of a source; the one that is on goes on if there is one."""
        if self.runs:
            return
        self.close()
        command = [sys.executable, "-m", "placefield_tools", "replay", *self._flags]
        command += ["--rate", f"{rate:g}"] if rate is not None else []
        command += ["--loop"] if loop else []
        self._process = subprocess.Popen(
            [*command, "--", source],
            stdin=subprocess.PIPE,  # its end tells the child that this process is gone
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=child_environment(),
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self._source, self._said = source, deque(maxlen=_LINES)
        self._hearing = threading.Thread(
            target=_hear, args=(self._process.stdout, self._said), daemon=True
        )
        self._hearing.start()

    def stop(self) -> None:
        """Ask the replay to end, if it is on."""
        if self._process is not None and self.runs:
            self._process.terminate()

    def close(self) -> None:
        """End the replay, and wait until it has."""
        if self._process is None:
            return
        self.stop()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._hearing.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()
        self._process = None

    @property
    def standing(self) -> str:
        """What there is to say of it: its one line of error, if it has failed."""
        if self._process is None:
            return "no replay was started here"
        if self.runs or self._hearing.is_alive():
            return f"replaying {without_secrets(self._source)}"
        lines = list(self._said)
        errors = [line.removeprefix(_OURS) for line in lines if line.startswith(_OURS)]
        if self._process.returncode and errors:
            return errors[-1]
        return lines[-1] if lines else f"ended with code {self._process.returncode}"


def _hear(lines: Iterable[str], said: deque[str]) -> None:
    said.extend(line.strip() for line in lines if line.strip())
