"""A command with the time that it takes and the memory that it holds."""

import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Watched:
    """Time and memory of a command."""

    seconds: float
    peak_mb: float


def watched(command: Sequence[str]) -> Watched:
    """Run a command and watch its memory.

    Raises:
        RuntimeError: it fails.
    """
    start, peak = time.perf_counter(), 0.0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None:
            peak = max(peak, peak_mb_of(process.pid))
            time.sleep(0.02)
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return Watched(time.perf_counter() - start, peak)


def peak_mb_of(process: int) -> float:
    """Return the most memory that a process has held; 0 where it is gone or nobody can tell."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) * 1.024e-3 for line in lines if line.startswith("VmHWM"))
