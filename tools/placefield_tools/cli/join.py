"""``placefield join``: maps to one map of all their routes."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield_tools.cli import options_map, options_routes


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("join")(_join)


def _join(
    maps: Annotated[
        list[Path], typer.Argument(metavar="MAP...", help="two maps or more: NAME.pfmap")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="the joined map: NAME.pfmap")],
    overwrite: options_map.Overwrite = False,
    links: options_routes.Links = None,
    same_frame: options_routes.SameFrame = False,
) -> None:
    """Join maps to one map that has the routes of all, and the links between them.

    The maps stay as they are. They must have the same features, and looks of their places are kept.
    The settings of the first map are those of the joined map, and segments and metrics are made
    anew. Links are found as by 'placefield build --routes'.

    Examples:
      placefield join north.pfmap south.pfmap -o town.pfmap
      placefield join north.pfmap south.pfmap --link north:120,south:0 -o town.pfmap
    """
    from placefield_tools.build.map_from_maps import join_maps
    from placefield_tools.inspect.route_facts import route_lines, warn_of_unlinked

    if len(maps) < 2:
        raise ConfigError("join: give two maps or more")
    known = options_routes.route_options(links, same_frame=same_frame)
    joined = options_map.saved_new(partial(join_maps, maps, known), output, overwrite=overwrite)
    print(f"{output}: {joined.places.count} places, {len(joined.channels)} channels")
    for line in route_lines(joined):
        print(line)
    warn_of_unlinked(joined)
