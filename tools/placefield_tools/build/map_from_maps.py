"""Joining maps to one map with the routes of all."""

from collections.abc import Sequence
from pathlib import Path

from placefield.errors import MapError
from placefield.features.joined_model import parts_of
from placefield.maps.joining_maps import check_joinable, config_of, traverses_of, with_records
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield_tools.build.map_from_sources import built_of
from placefield_tools.build.routes_from_sources import RouteOptions
from placefield_tools.build.used_part import UsedPart


def join_maps(paths: Sequence[Path], options: RouteOptions, *, kept_in: Path | None = None) -> Map:
    """Join the maps at two or more paths, showing progress.

    Args:
        paths: of the maps.
        options: about the routes.
        kept_in: see ``build_from``.

    Raises:
        MapError: a map cannot be read, cannot be joined with the first, or is given twice.
    """
    maps: list[Map] = []
    for path in paths:
        opened = open_map(path)
        if opened.digest in {each.digest for each in maps}:
            raise MapError(f"{path}: is given twice; give different maps")
        maps.append(opened)
        try:
            check_joinable(maps[0], opened)
        except MapError as error:
            raise MapError(f"{path}: {error}") from None
    traverses = traverses_of(maps, options.links, same_frame=options.same_frame)
    model = maps[0].model
    built = built_of(traverses, config_of(maps), parts_of(model), kept_in)
    return with_records(UsedPart(model.view, model.mask).in_map(built), maps)
