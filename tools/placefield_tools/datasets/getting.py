"""Downloading a benchmark into a folder, which appears under its name only when complete.

The work is done in NAME.partial, which is renamed at the end. If the work is interrupted, the
downloaded files stay there.
"""

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from placefield.errors import SourceError
from placefield.locking import take_lock
from placefield_tools.datasets.benchmarks import TRUTH, Benchmark, File
from placefield_tools.datasets.downloading import download
from placefield_tools.datasets.ground_truth import write_truth
from placefield_tools.datasets.sums import read_sums, sum_of, write_sums
from placefield_tools.datasets.unpacking import unpack

Progress = Callable[[int, int, int | None], None]
"""Called with the number of a file (from 0), its bytes so far, and their total if known."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def sums_file(benchmark: Benchmark, into: Path) -> Path:
    """Return the path of the stored checksums of files without a known checksum."""
    return into / f"{benchmark.name}.sha256"


def get(benchmark: Benchmark, into: Path, progress: Progress) -> Path:
    """Download a benchmark, check it and unpack it.

    Args:
        benchmark: one that has files.
        into: the folder in which the benchmark's folder is created.
        progress: called with the progress.

    Returns:
        The benchmark's folder.

    Raises:
        SourceError: the benchmark must be downloaded by hand, exists already or cannot be
            downloaded, a file has a wrong checksum, or the disk refuses.
    """
    folder = into / benchmark.name
    if benchmark.by_hand:
        raise SourceError(f"{benchmark.name}: {benchmark.by_hand}; put it in {folder}")
    if os.path.lexists(folder):
        raise SourceError(
            f"{folder}: exists already; 'placefield datasets check {benchmark.name} {folder}' "
            "checks it; remove it to download it again"
        )
    partial = into / f"{benchmark.name}.partial"
    with disk_errors_reported(partial):
        partial.mkdir(parents=True, exist_ok=True)
        with alone(partial):
            _download(benchmark, partial, sums_file(benchmark, into), progress)
            assembled = _assemble(benchmark, partial)
            _keep_sums(benchmark, partial, sums_file(benchmark, into))
            assembled.rename(folder)
            shutil.rmtree(partial)
    return folder


def _download(benchmark: Benchmark, partial: Path, sums_kept: Path, progress: Progress) -> None:
    for number, file in enumerate(benchmark.files):
        come = _come(partial, file)
        if not come.exists():
            part = come.with_name(f"{come.name}.part")
            part.parent.mkdir(parents=True, exist_ok=True)
            url = f"{benchmark.files_at}{file.name}"
            download(url, part, file.bytes, lambda *there, number=number: progress(number, *there))
            _check(file, part, sums_kept)
            part.rename(come)


def _check(file: File, part: Path, sums_kept: Path) -> None:
    """Compare a file's checksum with the known one, or with that of the first download."""
    wanted = file.sha256 or read_sums(sums_kept).get(file.name)
    if wanted and (found := sum_of(part)) != wanted:
        part.unlink()
        why = "is known" if file.sha256 else f"{sums_kept} says; remove that if you trust this one"
        raise SourceError(f"{file.name}: removed, its SHA-256 is {found} and not {wanted} as {why}")


def _keep_sums(benchmark: Benchmark, partial: Path, sums_kept: Path) -> None:
    """Store the checksums of files without a known one; they were unpacked, so are complete."""
    known = read_sums(sums_kept)
    news = [file for file in benchmark.files if not file.sha256 and file.name not in known]
    if news:
        write_sums(sums_kept, known | {file.name: sum_of(_come(partial, file)) for file in news})


def _assemble(benchmark: Benchmark, partial: Path) -> Path:
    assembled = partial / "assembled"
    shutil.rmtree(assembled, ignore_errors=True)
    for file in benchmark.files:
        come = _come(partial, file)
        if file.is_archive:
            unpack(come, assembled / file.into)
        else:
            target = assembled / file.name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(come, target)
    if benchmark.truth_matrix:
        write_truth(assembled / benchmark.truth_matrix, assembled / TRUTH)
    return assembled


def _come(partial: Path, file: File) -> Path:
    return partial / "files" / file.name


@contextmanager
def alone(partial: Path) -> Iterator[None]:
    """Hold the lock of a folder; the system releases it when the process ends, even if killed."""
    with (partial / ".lock").open("ab") as opened:
        if not take_lock(opened):
            raise SourceError(f"{partial}: another process downloads it; wait for that")
        yield


@contextmanager
def disk_errors_reported(partial: Path) -> Iterator[None]:
    """Raise a disk error as ``SourceError``, which says what to do."""
    try:
        yield
    except OSError as error:
        what = error.strerror or str(error)
        if error.errno in _FULL:
            what = "the disk is full; free some space and run the same command again to go on"
        raise SourceError(f"{error.filename or partial}: {what}") from None
