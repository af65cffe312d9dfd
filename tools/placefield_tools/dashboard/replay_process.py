"""A replay that the page starts and stops: the command runs in its own process."""

import subprocess
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path

from placefield.config import BusConfig
from placefield_services.child_environment import supervised_environment
from placefield_tools.common.own_command import PLACEFIELD
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
    """One replay at a time, shared by all viewers; it ends with this process."""

    def __init__(self, flags: Sequence[str]) -> None:
        """Keep the flags that name the run and the bus."""
        self._flags = flags
        self._source = ""
        self._was_stopped = False
        self._process: subprocess.Popen[str] | None = None
        self._said: deque[str] = deque(maxlen=_LINES)
        self._reader = threading.Thread()

    @property
    def runs(self) -> bool:
        """Whether a replay is running."""
        return self._process is not None and self._process.poll() is None

    @property
    def has_failed(self) -> bool:
        """Whether the last replay has ended with an error."""
        return bool(self._process and self._process.poll() and not self._was_stopped)

    def start(self, source: str, rate: float | None, camera: str, *, loop: bool) -> None:
        """Start to replay a source; does nothing if a replay is running.

        Args:
            source: of the frames.
            rate: frames per second; None: as fast as they are answered.
            camera: the file of the camera; empty: there is none.
            loop: whether it repeats from the start.
        """
        if self.runs:
            return
        self.close()
        command = [*PLACEFIELD, "replay", *self._flags]
        command += ["--rate", f"{rate:g}"] if rate is not None else []
        command += [f"--camera={camera}"] if camera else []
        command += ["--loop"] if loop else []
        self._process = subprocess.Popen(
            [*command, "--", source],
            stdin=subprocess.PIPE,  # it closes with this process, and the child notices
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=supervised_environment(),
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self._source, self._said = source, deque(maxlen=_LINES)
        self._was_stopped = False
        self._reader = threading.Thread(
            target=_read_lines, args=(self._process.stdout, self._said), daemon=True
        )
        self._reader.start()

    def stop(self) -> None:
        """Ask a running replay to end."""
        if self._process is not None and self.runs:
            self._was_stopped = True
            self._process.terminate()

    def close(self) -> None:
        """End the replay and wait for its end."""
        if self._process is None:
            return
        self.stop()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()
        self._process = None

    @property
    def status(self) -> str:
        """The state of the replay in words; its line of error, if it has failed."""
        if self._process is None:
            return "no replay was started here"
        if self.runs or self._reader.is_alive():
            return f"replaying {without_secrets(self._source)}"
        lines = list(self._said)
        errors = [line.removeprefix(_OURS) for line in lines if line.startswith(_OURS)]
        if self._process.returncode and errors:
            return errors[-1]
        ended = lines[-1] if lines else f"ended with code {self._process.returncode}"
        return f"stopped by hand: {ended}" if self._was_stopped else ended


def _read_lines(lines: Iterable[str], said: deque[str]) -> None:
    said.extend(line.strip() for line in lines if line.strip())
