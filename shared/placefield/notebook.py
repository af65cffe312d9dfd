"""HTML of maps and of matches, for notebooks."""

import base64
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from placefield.fusion.match import Match
    from placefield.maps.map import Map, Places

_PICTURES = 8
"""Number of places in a map's strip."""


def html_of_map(placemap: "Map") -> str:
    """Return a table of a map's facts, and a strip of its places, if they have thumbnails."""
    places, channels = placemap.places, placemap.channels
    rows = {
        "map": placemap.digest if placemap.is_saved else "not saved",
        "places": str(places.count),
        "references": ", ".join(f"{one.name} ({one.frames})" for one in placemap.traverses),
        "feature": placemap.features.kind,
        "poses": placemap.pose_frame or "none",
    }
    for number, channel in enumerate(channels):
        lengths = f"{channel.scales[0]} to {channel.scales[-1]} frames"
        learned = "learned" if channel.metric.learned else "identity"
        rows[f"channel {number}"] = (
            f"{len(channel.segments)} segments of {lengths}, {learned} metric"
        )
    chosen = np.unique(np.linspace(0, places.count - 1, _PICTURES).astype(int)).tolist()
    return _table(rows) + (_strip(places, chosen) if places.has_thumbnails else "")


def html_of_match(match: "Match") -> str:
    """Return a table of a match; fields without a value are left out."""
    rows = {"place": str(match.place) if match.place >= 0 else "unanswered"}
    if match.pose is not None:
        rows["pose"] = f"{match.pose.x:.2f} m, {match.pose.y:.2f} m, {match.pose.yaw:.3f} rad"
    rows["score"] = f"{match.score:.4g}"
    if match.probability is not None:
        rows["probability"] = f"{match.probability:.4g}"
    if match.new is not None:
        rows["new place"] = f"{match.new:.4g}"
    if match.known is not None:
        rows["known"] = "yes" if match.known else "no"
    if match.missing:
        rows["missing channels"] = ", ".join(map(str, match.missing))
    flags = (("too fast", match.too_fast), ("forgotten", match.forgotten))
    rows |= {name: "yes" for name, is_so in flags if is_so}
    return _table(rows)


def _table(rows: dict[str, str]) -> str:
    cells = (
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows.items()
    )
    return f"<table>{''.join(cells)}</table>"


def _strip(places: "Places", chosen: Iterable[int]) -> str:
    pictures = (
        f'<img src="data:image/jpeg;base64,{base64.b64encode(places.thumbnail(place)).decode()}" '
        f'title="place {place}" alt="place {place}" style="height:5em;display:inline">'
        for place in chosen
    )
    return f"<div>{''.join(pictures)}</div>"
