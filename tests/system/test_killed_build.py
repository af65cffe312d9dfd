"""A build that is killed, and started again."""

import signal
import subprocess
import time
from pathlib import Path

import numpy as np

from placefield_tools.common.own_command import PLACEFIELD

CHANNELS = 6
PATIENCE_S = 120.0


def started(references: list[str], path: Path) -> subprocess.Popen[str]:
    command = [*PLACEFIELD, "build", *references, "-o", str(path), "--channels", str(CHANNELS)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def log_of(references: list[str], path: Path) -> str:
    with started(references, path) as process:
        _, log = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, log
    return log


def content_of(path: Path) -> dict[str, bytes]:
    files = (file for file in path.rglob("*") if file.is_file())
    return {str(file.relative_to(path)): file.read_bytes() for file in files}


def test_after_a_kill_finished_channels_are_not_made_again_and_the_map_has_the_same_bits(
    tmp_path: Path,
) -> None:
    walk = np.cumsum(np.random.default_rng(0).normal(size=(600, 20)), axis=0)
    references = [str(tmp_path / "day.npy")]
    np.save(references[0], walk.astype(np.float32))
    path, kept = tmp_path / "killed.pfmap", tmp_path / "killed.pfmap.building"

    with started(references, path) as process:
        end = time.monotonic() + PATIENCE_S
        while not (kept / "channel-1-clusters.npz").exists():
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    finished = {file.name for file in kept.glob("*.npz")}
    assert "channel-5-metric.npz" not in finished

    resumed = log_of(references, path)
    assert {name for name in finished if f"{name}: finished before" in resumed} == finished
    assert resumed.count("finished before") == len(finished)
    assert not kept.exists()
    undisturbed = log_of(references, tmp_path / "undisturbed.pfmap")
    assert "finished before" not in undisturbed
    assert content_of(path) == content_of(tmp_path / "undisturbed.pfmap")
