"""Options about which matches are right, and about protocols."""

from pathlib import Path
from typing import Annotated

import typer

from placefield.config import Config
from placefield.errors import ConfigError
from placefield.evaluation.protocols import (
    DEFAULT_EVERY,
    SHORT_REFERENCE,
    SHORT_SPEED_EVERY,
    SPEED_EVERY,
    TAKES_EVERY,
    Protocol,
)
from placefield.evaluation.truth import Near, Truth, read_truth
from placefield_tools.cli.options import METRES, metres_of

_DEFAULTS = Config()


Tolerance = Annotated[
    str | None,
    typer.Option(
        metavar="N or Nm",
        help="a match is right within so many places, or within metres by the poses of both sides",
        show_default=str(_DEFAULTS.matching.tolerance),
    ),
]
Aligned = Annotated[
    bool,
    typer.Option(
        "--aligned",
        help="query frame i shows place i (i/n of a thinned reference); poses and counts are not "
        "used",
    ),
]
SameFrame = Annotated[
    bool,
    typer.Option(
        "--same-frame",
        help="the poses of REF and QUERY share one frame in metres, and give the ground truth",
    ),
]
TruthFile = Annotated[
    Path | None,
    typer.Option(
        "--truth",
        help="ground truth as CSV: query,first,last, frame numbers before any thinning; or "
        "query,route,place for 'evaluate' on a map of routes, where near places are right, too",
    ),
]
ProtocolOption = Annotated[
    Protocol, typer.Option("--protocol", help="how the vehicle drives the query")
]
Every = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="use every N-th frame: of the reference with --protocol speed, odometry and dense, of "
        "the query with sparse",
        show_default=f"{DEFAULT_EVERY}; speed and odometry: {SPEED_EVERY}, or "
        f"{SHORT_SPEED_EVERY} if the reference has fewer than {SHORT_REFERENCE} frames",
    ),
]
Other = Annotated[
    str | None,
    typer.Option(
        metavar="SOURCE", help="frames of another route, which --protocol off-route turns into"
    ),
]


def places_or_metres(text: str | None) -> tuple[int | None, float | None]:
    """Return ``--tolerance`` as places or as metres; the other one is None.

    Raises:
        ConfigError: the text has another form.
    """
    if text is None:
        return None, None
    if text.isdecimal():
        return int(text), None
    if METRES.fullmatch(text):
        return None, metres_of("--tolerance", text)
    raise ConfigError(f"--tolerance {text!r}: write places as 3, or metres as 5m")


def check_truth(
    tolerance: str | None, truth: Path | None, *, aligned: bool, same_frame: bool
) -> None:
    """Refuse options that define the ground truth twice.

    Raises:
        ConfigError: more than one of them is given.
    """
    if tolerance is not None and truth is not None:
        raise ConfigError("--tolerance and --truth: give one of them")
    given = {"--truth": truth is not None, "--aligned": aligned, "--same-frame": same_frame}
    if sum(given.values()) > 1:
        raise ConfigError(
            f"{' and '.join(flag for flag in given if given[flag])}: give one of them"
        )
    if aligned and places_or_metres(tolerance)[1] is not None:
        raise ConfigError(f"--aligned: needs --tolerance in places, not {tolerance}")


def places_near_in(map_path: Path, tolerance: int) -> Near:
    """Return what gives the places near a place of a map, along its routes and links.

    Args:
        map_path: the map.
        tolerance: steps of one place.
    """
    from placefield.maps.near_places import places_near
    from placefield.maps.opening import open_map
    from placefield.maps.route_graph import place_in

    opened = open_map(map_path, channels=())
    graph, count = opened.graph, opened.places.count
    return lambda route, number: places_near(
        graph, count, place_in(graph, count, route, number), tolerance
    )


def truth_of(
    queries: int,
    references: int,
    every: int = 1,
    *,
    tolerance: int | None,
    truth: Path | None,
    near: Near | None = None,
) -> Truth:
    """Return the ground truth: from the file, or else within the tolerance.

    Args:
        queries: number of query frames.
        references: number of frames of the reference. The file counts these frames.
        every: every so many frames of the reference are places.
        tolerance: in places; not used if a file is given.
        truth: the file of the ground truth.
        near: see ``read_truth``.

    Raises:
        TruthError: the file does not fit so many frames.
    """
    if truth is not None:
        return read_truth(truth, queries, references, near).thinned(references, every)
    return Truth.within(queries, references, tolerance or 0, every)


def check_every(protocol: Protocol, every: int | None) -> None:
    """Refuse ``--every`` with a protocol that uses all frames.

    Raises:
        ConfigError: the protocol does not use ``--every``.
    """
    if every is not None and protocol not in TAKES_EVERY:
        raise ConfigError(
            f"--every {every}: only --protocol speed, odometry, dense and sparse use every n-th "
            "frame; leave it out"
        )


def check_other(protocol: Protocol, other: str | None) -> None:
    """Check that another route's frames are given if and only if the protocol needs them.

    Raises:
        ConfigError: the frames are missing, or the protocol does not use them.
    """
    if protocol == "off-route" and other is None:
        raise ConfigError("--protocol off-route: give the other route's frames with --other")
    if protocol != "off-route" and other is not None:
        raise ConfigError(
            f"--other {other}: only --protocol off-route uses another route; leave it out"
        )
