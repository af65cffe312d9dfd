"""``placefield drop``: a drive out of a map."""

from typing import Annotated

import typer

from placefield_tools.cli import options, options_map


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("drop")(_drop)


def _drop(
    map_path: options.MapPath,
    drive: Annotated[
        str,
        typer.Argument(
            metavar="DRIVE", help="name of a drive in the map, as 'placefield inspect' has it"
        ),
    ],
    output: options_map.ChangedMap = None,
) -> None:
    """Drop a drive from a map: its looks, and the places that it added.

    The matches are then as before the drive was added. What the map learned from a drive when it
    was built, PCA and metrics, stays. The first drive cannot be dropped.

    Examples:
      placefield drop route.pfmap night/
    """
    from placefield.maps.changing import map_to_change
    from placefield.maps.dropping import drop_traverse, number_of
    from placefield.maps.store import save_map

    output = options_map.changed_map(map_path, output)
    with map_to_change(map_path) as opened:
        dropped = drop_traverse(opened, number_of(opened.traverses, drive))
        save_map(dropped, output)
    removed = opened.places.count - dropped.places.count
    print(f"{output}: {dropped.places.count} places; {drive} is dropped, with {removed} places")
