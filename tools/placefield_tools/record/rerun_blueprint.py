"""How Rerun lays out a recording: what the dashboard shows first, as far as a recording has it."""

from typing import TYPE_CHECKING

import rerun as rr
import rerun.blueprint as rrb

if TYPE_CHECKING:
    from rerun.blueprint.api import VisualizerLike
    from rerun.encodings import EntityPathLike

_KINDS = {
    "": ("at once", (0, 114, 178)),
    "smoothed/": ("smoothed", (0, 158, 115)),
    "verified/": ("verified", (204, 121, 167)),
}
"""Where the entities of each kind of match are, and its name and colour."""

_GREY = (138, 138, 138)


def blueprint(*, georeferenced: bool, frames: bool) -> rrb.Blueprint:
    """Return the layout: images and route above; certainty and places over time below.

    Args:
        georeferenced: whether there are positions on the earth; else the route is drawn in metres.
        frames: whether there are images of the query, beside which those of the places are drawn.
    """
    route = _georeferenced() if georeferenced else _route()
    images = (
        rrb.Spatial2DView(origin="/frame", name="Query"),
        rrb.Spatial2DView(origin="/place", name="Reference: its place, at once"),
    )
    certainty = rrb.TimeSeriesView(
        name="Certainty",
        contents=[*_of_each_kind("match/probability"), "+ /match/asked"],
        overrides={
            **_lines("match/probability"),
            "/match/asked": rr.SeriesLines(names="asked", colors=_GREY, widths=1),
        },
        axis_y=rrb.ScalarAxis(range=(0, 1.05)),
    )
    places = rrb.TimeSeriesView(
        name="Place", contents=_of_each_kind("match/place"), overrides=_lines("match/place")
    )
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*images, route) if frames else route,
            rrb.Horizontal(certainty, places),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="stamp", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _georeferenced() -> rrb.MapView:
    return rrb.MapView(name="Map", contents=_of_each_kind("earth/position"))


def _route() -> rrb.Spatial3DView:
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    return rrb.Spatial3DView(
        name="Route so far",
        contents=_of_each_kind("route/position"),
        time_ranges=[rrb.VisibleTimeRange("stamp", start=start, end=now)],
    )


def _of_each_kind(entity: str) -> list[str]:
    return [f"+ /{kind}{entity}" for kind in _KINDS]


def _lines(entity: str) -> "dict[EntityPathLike, VisualizerLike]":
    return {
        f"/{kind}{entity}": rr.SeriesLines(names=name, colors=colour)
        for kind, (name, colour) in _KINDS.items()
    }
