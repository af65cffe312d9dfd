"""``placefield inspect``: the contents of a map."""

from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("inspect")(_inspect)


def _inspect(
    map_path: options.MapPath,
    picture: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="picture of the segments",
            show_default="MAP-segments.png",
        ),
    ] = None,
) -> None:
    """Print the contents of a map, and draw its segments per channel.

    If the map has several traverses, a second picture, NAME-alignment.png beside the first, shows
    how each was aligned. If it has several routes or links, NAME-network.png shows them.

    Examples:
      placefield inspect route.pfmap -o segments.png
    """
    from placefield.maps.opening import open_map
    from placefield_tools.common.outputs import check_folder_of
    from placefield_tools.inspect.map_summary import (
        draw_alignment,
        draw_network,
        draw_segments,
        print_map,
    )

    path = picture or map_path.with_name(f"{map_path.stem}-segments.png")
    check_folder_of(path)
    opened = open_map(map_path)
    print_map(opened, map_path)
    draw_segments(opened, path)
    print(path)
    stem = path.stem.removesuffix("-segments")
    if opened.alignments:
        draw_alignment(opened, alignment := path.with_name(f"{stem}-alignment.png"))
        print(alignment)
    if not opened.graph.is_line:
        draw_network(opened, network := path.with_name(f"{stem}-network.png"))
        print(network)
