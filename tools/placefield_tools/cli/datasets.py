"""``placefield datasets``: the public benchmarks."""

from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield_tools.cli import options

_Name = Annotated[
    str, typer.Argument(metavar="NAME", help="name of a benchmark", show_default=False)
]
_Folder = Annotated[
    Path, typer.Argument(metavar="FOLDER", help="folder of the benchmark", show_default=False)
]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    datasets = typer.Typer(invoke_without_command=True)
    datasets.callback()(_list)
    datasets.command("show")(_show)
    datasets.command("get")(_get)
    datasets.command("truth")(_truth)
    datasets.command("check")(_check)
    app.add_typer(datasets, name="datasets")


def _list(context: typer.Context) -> None:
    """List the public benchmarks by name; show, get and check one, make its ground truth.

    Examples:
      placefield datasets
      placefield datasets get gardens-point --into benchmarks
    """
    from placefield_tools.datasets.benchmarks import benchmarks
    from placefield_tools.datasets.showing import print_list

    if context.invoked_subcommand is None:
        print_list(benchmarks().values())


def _show(name: _Name) -> None:
    """Print a benchmark's layout, tolerance, ground truth and licence, and how to run it here.

    Examples:
      placefield datasets show nordland
    """
    from placefield_tools.datasets.benchmarks import benchmark
    from placefield_tools.datasets.showing import print_benchmark

    print_benchmark(benchmark(name), Path(name))


def _get(
    name: _Name,
    into: Annotated[
        Path, typer.Option(metavar="FOLDER", help="parent of the benchmark's folder")
    ] = Path(),
) -> None:
    """Download a benchmark where its licence lets a program do so, check it and unpack it.

    What was cut off goes on when the same command is run again. Every file must have the SHA-256
    sum that is known, or else the one of the first time, which is kept in FOLDER/NAME.sha256.

    Examples:
      placefield datasets get corridor --into benchmarks
    """
    from placefield_tools.common.progress import progress_bar
    from placefield_tools.datasets.benchmarks import benchmark
    from placefield_tools.datasets.checking import check
    from placefield_tools.datasets.getting import get, sums_file
    from placefield_tools.datasets.showing import study_command

    known = benchmark(name)
    count = len(known.files)
    with progress_bar() as bar:
        task = bar.add_task("", visible=False)

        def show(number: int, there: int, total: int | None) -> None:
            bar.update(
                task,
                description=f"file {number + 1} of {count}, KiB",
                visible=True,
                completed=there >> 10,
                total=None if total is None else total >> 10,
            )

        folder = get(known, into, show)
    _print_counts(folder, check(known, folder))
    print(f"licence: {known.licence}")
    if not all(file.sha256 for file in known.files):
        print(f"{sums_file(known, into)}: what came is to be the same the next time")
    if command := study_command(known, folder):
        print(command)


def _truth(
    name: _Name,
    folder: _Folder,
    tolerance: Annotated[
        str | None,
        typer.Option(
            metavar="Nm",
            help="how many metres off a right place is at most",
            show_default="what 'show' says",
        ),
    ] = None,
) -> None:
    """Make a benchmark's ground truth from its GPS: FOLDER/truth.csv, as --truth takes it.

    Right for a query frame are all frames of the reference within the tolerance. Where GPS has
    fewer fixes than the film has frames, frames between two fixes lie evenly between them. Query
    frames without a fix, or further off than that, are off the route.

    Examples:
      placefield datasets truth st-lucia st-lucia
      placefield datasets truth st-lucia st-lucia --tolerance 2m
    """
    from placefield_tools.datasets.benchmarks import TRUTH, benchmark
    from placefield_tools.datasets.gps_truth import write_gps_truth
    from placefield_tools.datasets.showing import study_command

    known = benchmark(name)
    if known.truth_gps is None:
        raise ConfigError(
            f"{name}: its ground truth is not made from GPS; 'placefield datasets show {name}' "
            "says what it is"
        )
    metres = (
        known.truth_gps.metres if tolerance is None else options.metres_of("--tolerance", tolerance)
    )
    placed, queries = write_gps_truth(known, folder, metres)
    print(f"{folder / TRUTH}: {placed} of {queries} query frames have a place within {metres:g} m")
    print(study_command(known, folder))


def _check(
    name: _Name,
    folder: _Folder,
) -> None:
    """Check that a benchmark lies in a folder as it should, and count its frames.

    Examples:
      placefield datasets check gardens-point benchmarks/gardens-point
    """
    from placefield_tools.datasets.benchmarks import benchmark
    from placefield_tools.datasets.checking import check
    from placefield_tools.datasets.showing import study_command

    known = benchmark(name)
    _print_counts(folder, check(known, folder))
    if command := study_command(known, folder):
        print(command)


def _print_counts(folder: Path, counts: dict[str, int]) -> None:
    print(f"{folder}: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
