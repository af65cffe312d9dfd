"""Options about the routes of a map."""

from typing import TYPE_CHECKING, Annotated

import typer

from placefield.errors import ConfigError

if TYPE_CHECKING:
    from placefield_tools.build.routes_from_sources import RouteOptions

Links = Annotated[
    list[str] | None,
    typer.Option(
        "--link",
        metavar="A:120,B:0",
        help="a vehicle may pass from place 120 of route A to place 0 of route B; may be repeated",
        show_default=False,
    ),
]
SameFrame = Annotated[
    bool,
    typer.Option(
        "--same-frame", help="the poses of all routes share one frame in metres, and show links"
    ),
]


def route_options(links: list[str] | None, *, same_frame: bool) -> "RouteOptions":
    """Return what a user knows about the routes.

    Raises:
        ConfigError: a link has another form.
    """
    from placefield_tools.build.routes_from_sources import RouteOptions, link_of

    return RouteOptions(tuple(map(link_of, links or ())), same_frame)


def refuse_without_routes(links: list[str] | None, *, same_frame: bool) -> None:
    """Refuse options about routes in a map of one route.

    Raises:
        ConfigError: there are some.
    """
    if links or same_frame:
        raise ConfigError("--link and --same-frame: are about several routes; give --routes")
