"""A build that is interrupted: what a person's Ctrl-C, or an operator's signal, leaves behind."""

import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import cv2
import numpy as np
import psutil
import pytest

_HIDE_CURSOR, _SHOW_CURSOR = b"\x1b[?25l", b"\x1b[?25h"


class OnTerminal:
    """A command on a terminal of its own, where it shows its progress."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        outer, inner = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "placefield_tools", *arguments],
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder), "TERM": "xterm"},
            stdin=inner,
            stdout=inner,
            stderr=inner,
            start_new_session=True,
            # Who runs the tests in the background has it ignored, and so had this command.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        os.close(inner)
        self.shown = b""
        self._reader = Thread(target=self._read, args=(outer,))
        self._reader.start()

    def _read(self, terminal: int) -> None:
        try:
            while block := os.read(terminal, 4096):
                self.shown += block
        except OSError:  # Linux says so where nobody has the terminal any more
            pass
        os.close(terminal)

    def wait_until_shown(self, text: bytes) -> None:
        patience = time.monotonic() + 120
        while text not in self.shown:
            assert self.process.poll() is None, self.shown
            assert time.monotonic() < patience, self.shown
            time.sleep(0.02)

    def wait(self) -> int:
        code = self.process.wait(60)
        self._reader.join(60)
        return code


@pytest.fixture(scope="module")
def long_route(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames enough for a build that takes its time."""
    folder = tmp_path_factory.mktemp("long") / "route"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(200):
        cv2.imwrite(str(folder / f"{number:04}.jpg"), rng.integers(0, 256, (32, 32), np.uint8))
    return folder


SETTINGS = ("--channels", "8", "--set", "metric.gate=false", "--set", "metric.steps=100000")


@pytest.mark.parametrize("whom", ["group", "process"])
@pytest.mark.parametrize("when", ["channel", "learning"])
def test_an_interrupted_build_leaves_nothing_but_finished_steps(
    long_route: Path, tmp_path: Path, whom: str, when: str
) -> None:
    at = {"channel": b"channel 0", "learning": b": learning"}[when]
    build = OnTerminal(tmp_path, "build", str(long_route), "-o", "route.pfmap", *SETTINGS)
    try:
        build.wait_until_shown(at)
        children = psutil.Process(build.process.pid).children(recursive=True)
        send = os.killpg if whom == "group" else os.kill
        send(build.process.pid, signal.SIGINT)
        code = build.wait()
    finally:
        build.process.kill()
    assert code in (1, 130), build.shown
    assert b"Traceback" not in build.shown
    finished = tmp_path / "route.pfmap.building"  # for the next try
    assert {*tmp_path.iterdir()} <= {finished}
    assert {file.suffix for file in finished.glob("*")} <= {".npz"}
    assert not any(child.is_running() for child in children)
    assert build.shown.rfind(_SHOW_CURSOR) > build.shown.rfind(_HIDE_CURSOR) >= 0
