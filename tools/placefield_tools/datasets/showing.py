"""Printing the registry of benchmarks."""

import shlex
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from placefield_tools.datasets.benchmarks import TRUTH, Benchmark


def print_list(benchmarks: Iterable[Benchmark]) -> None:
    """Print the names and titles of benchmarks."""
    table = Table("name", "benchmark", "size", "to get")
    for column in table.columns:
        column.no_wrap = column.header != "benchmark"
    for known in benchmarks:
        how = "by hand" if known.by_hand else "datasets get"
        table.add_row(known.name, known.title, known.size, how)
    Console(markup=False).print(table)
    print("'placefield datasets show NAME' says the licence, the ground truth and how to run it")


def print_benchmark(known: Benchmark, folder: Path) -> None:
    """Print all facts about a benchmark."""
    for word, text in (
        ("benchmark", f"{known.title}: {known.about}"),
        ("citation", known.citation),
        ("licence", known.licence),
        ("page", known.page),
        *(("traverse", _traverse_line(known, folder, at)) for at in range(len(known.traverses))),
        ("tolerance", known.tolerance),
        ("ground truth", known.truth),
        ("to make it", truth_command(known, folder)),
        ("to get", known.by_hand or f"placefield datasets get {known.name}"),
        ("size", known.size),
        ("sums", _sums(known)),
        ("to run", study_command(known, folder) or "not here: see the notes"),
        ("notes", known.notes),
    ):
        if text:
            print(f"{word + ':':<14}{text}")


def study_command(known: Benchmark, folder: Path) -> str | None:
    """Return the command that runs a benchmark in a folder; None if it cannot be run here."""
    study = known.study
    if study is None:
        return None
    right = (
        ["--truth", str(folder / TRUTH)]
        if study.tolerance is None
        else ["--tolerance", str(study.tolerance)]
    )
    traverses = [str(folder / known.folder_of(name)) for name in (study.reference, study.query)]
    return shlex.join(["placefield", "study", *traverses, *right])


def truth_command(known: Benchmark, folder: Path) -> str | None:
    """Return the command that makes the ground truth in a folder; None if none is needed."""
    if known.truth_gps is None:
        return None
    return shlex.join(["placefield", "datasets", "truth", known.name, str(folder)])


def _traverse_line(known: Benchmark, folder: Path, at: int) -> str:
    traverse = known.traverses[at]
    frames = "an unknown number of" if traverse.frames is None else str(traverse.frames)
    return f"{traverse.name}: {frames} frames in {folder / traverse.folder}"


def _sums(known: Benchmark) -> str:
    if not known.files:
        return ""
    if all(file.sha256 for file in known.files):
        return "SHA-256 of every file is known and checked"
    return "no SHA-256 sums are known: those of the first download are stored and checked"
