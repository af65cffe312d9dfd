"""Building a map of several routes from sources of frames, one source for each route."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from placefield.config import Config
from placefield.errors import ConfigError
from placefield.maps.joining_routes import GivenLink, join_routes
from placefield.maps.map import Map
from placefield_tools.build.map_from_sources import built_of, describe_drives, open_reference
from placefield_tools.build.used_part import ALL_ASKED, AskedPart
from placefield_tools.sources import Parts

_LINK = re.compile(r"(.+):([0-9]{1,9}),(.+):([0-9]{1,9})")


@dataclass(frozen=True)
class RouteOptions:
    """What a user knows about the routes of a map.

    Attributes:
        links: between places of the routes.
        same_frame: whether poses that are not georeferenced are in the same metres.
    """

    links: tuple[GivenLink, ...] = ()
    same_frame: bool = False


def link_of(text: str) -> GivenLink:
    """Read a link such as ``A:120,B:0``.

    Raises:
        ConfigError: the text has another form.
    """
    found = _LINK.fullmatch(text)
    if found is None:
        raise ConfigError(f"--link {text!r}: write it as ROUTE:PLACE,ROUTE:PLACE, e.g. A:120,B:0")
    return found[1], int(found[2]), found[3], int(found[4])


def build_routes(
    references: Sequence[str],
    config: Config,
    parts: Parts,
    options: RouteOptions,
    *,
    spacing_m: float | None = None,
    leave_out_bad: bool = False,
    images: AskedPart = ALL_ASKED,
    kept_in: Path | None = None,
) -> Map:
    """Build a map of several routes, each from a source of its own, showing progress.

    A route has the name of its source's folder or file, with a number if another has this name.

    Args:
        references: sources of frames.
        config: of the map.
        parts: selects topics and frames of each source; has no file of poses.
        options: about the routes.
        spacing_m: see ``build_from``.
        leave_out_bad: see ``build_from``.
        images: what of the images is used, the same on all routes.
        kept_in: see ``build_from``.

    Raises:
        ConfigError: the descriptors are of plain PCA, which no rule serves on several routes; or
            see ``AskedPart.found``.
        SourceError: a source or one of its frames cannot be read, or a source is a camera.
        MapError: no map can be built of the routes, see ``join_routes`` and ``build_map``.
    """
    if config.features.plain_pca:
        raise ConfigError(
            "--routes: only --rule filter follows routes, and it does not serve descriptors of "
            "plain PCA: leave out --preset paper and features.plain_pca"
        )
    drives = [((reference,), parts) for reference in references]
    first, _ = drives[0]
    used = images.found(parts, partial(open_reference, first, spacing_m, parts))
    described, config, feature = describe_drives(
        drives,
        config,
        spacing_m=spacing_m,
        leave_out_bad=leave_out_bad,
        used=used,
    )
    routes = [each.traverse() for each in described]
    network = join_routes(routes, options.links, same_frame=options.same_frame)
    return used.in_map(built_of([network], config, feature.parts, kept_in))
