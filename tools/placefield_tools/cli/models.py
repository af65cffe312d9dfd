"""``placefield models``: networks by name."""

from pathlib import Path
from typing import Annotated

import typer

_Name = Annotated[str, typer.Argument(metavar="NAME", help="name of a network", show_default=False)]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    models = typer.Typer(invoke_without_command=True)
    models.callback()(_list)
    models.command("show")(_show)
    models.command("get")(_get)
    app.add_typer(models, name="models")


def _list(context: typer.Context) -> None:
    """List the networks that give features by name; show or get one.

    Examples:
      placefield models
    """
    from placefield_tools.models.registry import models
    from placefield_tools.models.showing import print_list

    if context.invoked_subcommand is None:
        print_list(models().values())


def _show(name: _Name) -> None:
    """Print a network's licences, input, dimension and checksum, and how to get it.

    Examples:
      placefield models show eigenplaces
    """
    from placefield_tools.models.registry import model
    from placefield_tools.models.showing import print_model

    print_model(model(name))


def _get(
    name: _Name,
    into: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="folder for NAME.onnx and NAME.toml",
            show_default="the folder where --feature NAME finds it",
        ),
    ] = None,
) -> None:
    """Fetch a network, and check its SHA-256.

    What was cut off goes on when the same command is run again.

    Examples:
      placefield models get mobilenetv2
    """
    from placefield_tools.common.progress import progress_bar
    from placefield_tools.models.getting import get, models_folder
    from placefield_tools.models.registry import model

    known = model(name)
    with progress_bar() as bar:
        task = bar.add_task(
            f"{name}, KiB", total=None if known.bytes is None else known.bytes >> 10
        )
        file = get(
            known, into or models_folder(), lambda there, _: bar.update(task, completed=there >> 10)
        )
    print(f"{file}: licence of the weights: {known.weights_licence}")
    print(f"--feature {name if into is None else f'onnx:{file}'}")
