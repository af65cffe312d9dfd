"""Checking the layout of a benchmark on disk."""

from pathlib import Path

from placefield.errors import SourceError
from placefield_tools.datasets.benchmarks import TRUTH, Benchmark, BenchmarkTraverse
from placefield_tools.datasets.showing import truth_command
from placefield_tools.sources.folder import IMAGE_SUFFIXES


def check(benchmark: Benchmark, folder: Path) -> dict[str, int]:
    """Count the frames of every traverse; a video counts as 1.

    Raises:
        SourceError: a traverse is missing, empty, or has a wrong number of frames, or its ground
            truth or positions are missing; the error lists all problems.
    """
    counts = {traverse.name: _count(folder / traverse.folder) for traverse in benchmark.traverses}
    wrong = [
        complaint
        for traverse in benchmark.traverses
        for complaint in _complaints(traverse, counts[traverse.name])
    ]
    wrong += _truth_complaints(benchmark, folder)
    if wrong:
        raise SourceError(
            f"{folder}: is not laid out as {benchmark.name}: {'; '.join(wrong)}; "
            f"see 'placefield datasets show {benchmark.name}'"
        )
    return counts


def _complaints(traverse: BenchmarkTraverse, count: int) -> list[str]:
    if count == 0:
        return [f"no frames in {traverse.folder}"]
    if traverse.frames not in (None, count):
        return [f"{count} frames in {traverse.folder}, and {traverse.frames} are expected"]
    return []


def _truth_complaints(benchmark: Benchmark, folder: Path) -> list[str]:
    complaints = [f"no {path}" for _, path in benchmark.gps_files if not (folder / path).is_file()]
    made = truth_command(benchmark, folder)
    if (made or benchmark.truth_matrix) and not (folder / TRUTH).is_file():
        complaints.append(f"no ground truth {TRUTH}" + (f", which '{made}' makes" if made else ""))
    return complaints


def _count(path: Path) -> int:
    if not path.is_dir():
        return int(path.is_file())
    return sum(
        entry.suffix.lower() in IMAGE_SUFFIXES and not entry.name.startswith(".")
        for entry in path.iterdir()
    )
