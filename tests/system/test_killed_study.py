"""A study that is cut off."""

import os
import signal
import subprocess
import time
from pathlib import Path

from placefield_tools.common.own_command import PLACEFIELD

PATIENCE_S = 120.0


def accept_ctrl_c() -> None:
    """Do not ignore Ctrl-C, as a process in the background of a script does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_a_study_that_is_cut_off_leaves_no_folder(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    command = [*PLACEFIELD, "study", str(reference_dir), str(query_dir), "-o", "new/folder"]
    with (
        log.open("w") as kept,
        subprocess.Popen(command, cwd=tmp_path, stderr=kept, preexec_fn=accept_ctrl_c) as process,
    ):
        end = time.monotonic() + PATIENCE_S
        while "building our map" not in log.read_text():
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) != 0
    assert os.listdir(tmp_path) == ["log"]
    assert "Traceback" not in log.read_text()
