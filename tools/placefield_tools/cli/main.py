"""The command ``placefield``."""

import sys
from collections.abc import Sequence
from typing import Annotated

import numpy as np  # noqa: F401 - loads its BLAS, to limit it
import typer
from threadpoolctl import threadpool_limits

from placefield import __version__
from placefield.errors import PlacefieldError
from placefield_tools.cli import (
    add,
    alive,
    bench,
    build,
    chaos,
    config,
    dashboard,
    datasets,
    demo,
    doctor,
    drop,
    evaluate,
    explore,
    export,
    fetch,
    inspect,
    join,
    listen,
    loops,
    models,
    plan,
    record,
    replay,
    ros,
    router,
    security,
    serve,
    services,
    status,
    study,
    up,
)
from placefield_tools.cli.helping import unwrapped
from placefield_tools.common.log_format import log, log_for_a_person

app = typer.Typer(
    help="Visual place recognition with adaptive multiple scales, as a stream of processes.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"placefield {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    asked: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    pass


_PANELS = {
    "Maps": (build, add, drop, join, inspect, serve, fetch),
    "Services": (up, services, explore, router, plan, status, alive),
    "Frames in": (replay, ros),
    "Matches out": (listen, dashboard, record, export, loops),
    "Accuracy and tests": (evaluate, study, bench, chaos, datasets, models),
    "This machine": (demo, doctor, config, security),
}


def _add_commands() -> None:
    for panel, modules in _PANELS.items():
        group = typer.Typer()
        for module in modules:
            module.add_to(group)
        _unwrap_help(group)
        for command in group.registered_commands:
            command.rich_help_panel = panel
        for sub_group in group.registered_groups:
            sub_group.rich_help_panel = panel
        app.registered_commands += group.registered_commands
        app.registered_groups += group.registered_groups


def _unwrap_help(group: typer.Typer) -> None:
    for command in group.registered_commands:
        command.help = unwrapped(command.callback)
    for sub_group in group.registered_groups:
        if sub_group.typer_instance is not None:
            _unwrap_help(sub_group.typer_instance)


_add_commands()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; a known error or a disk error is one line on stderr and exit code 1.

    BLAS uses one thread: the number of threads changes the last bits of products, and so the map.
    """
    log_for_a_person()
    try:
        with threadpool_limits(1):
            app(arguments)
    except PlacefieldError as error:
        log.error("%s", error)
        sys.exit(1)
    except OSError as error:
        where = f"{error.filename}: " if error.filename is not None else ""
        log.error("%s%s", where, error.strerror or error)
        sys.exit(1)


if __name__ == "__main__":
    main()
