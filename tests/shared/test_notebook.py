"""What a notebook shows of a map and of a match is HTML that needs nothing else."""

import base64
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from placefield import UNANSWERED, Match, Pose
from placefield.features.images import decode
from placefield.maps.manifest import TraverseRecord
from placefield.maps.map import Map


class Page(HTMLParser):
    """Reads the cells of tables and the images; every element is closed by its own end."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.cells: list[str] = []
        self.images: list[bytes] = []
        self._open: list[str] = []
        self.feed(html)
        assert not self._open

    @property
    def rows(self) -> dict[str, str]:
        return dict(zip(self.cells[::2], self.cells[1::2], strict=True))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in {"table", "tr", "th", "td", "div", "img"}
        if tag != "img":
            self._open.append(tag)
            self.cells += [""] * (tag in {"th", "td"})
            return
        kind, _, data = (dict(attrs)["src"] or "").partition(",")
        assert kind == "data:image/jpeg;base64"
        self.images.append(base64.b64decode(data))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] in {"th", "td"}:
            self.cells[-1] += data


def test_a_map_shows_its_facts_and_its_places(route_map: Map) -> None:
    page = Page(route_map._repr_html_())
    assert page.rows["map"] == route_map.digest
    assert page.rows["places"] == str(route_map.places.count)
    assert page.rows["feature"] == route_map.features.kind
    for number, channel in enumerate(route_map.channels):
        reported = page.rows[f"channel {number}"]
        assert reported.startswith(
            f"{len(channel.segments)} segments of {channel.scales.min()} to "
        )
    last = route_map.places.count - 1
    assert page.images[0] == route_map.places.thumbnail(0)
    assert page.images[-1] == route_map.places.thumbnail(last)
    assert all(decode(image).size for image in page.images)
    assert 2 <= len(page.images) <= 8


def test_a_map_of_few_places_shows_each_once(route_map: Map) -> None:
    places = route_map.places
    few = replace(places, stamps=places.stamps[:3])
    assert len(Page(replace(route_map, places=few)._repr_html_()).images) == 3


def test_names_cannot_be_markup(route_map: Map) -> None:
    name = "<script>alert('&')</script>\"day\""
    named = replace(route_map, traverses=(TraverseRecord(name=name, frames=9),))
    html = named._repr_html_()
    assert "<script" not in html
    assert name in Page(html).rows["references"]


@pytest.mark.parametrize("probability", [None, 0.875])
def test_a_match_shows_the_fields_that_it_has_and_no_more(probability: float | None) -> None:
    known = None if probability is None else False
    match = Match(7, 1.25, (2, 3), probability, known, True, pose=Pose(1.0, -2.5, np.pi))
    rows = Page(match._repr_html_()).rows
    assert rows["place"] == "7"
    assert rows["pose"] == "1.00 m, -2.50 m, 3.142 rad"
    assert rows["missing channels"] == "2, 3"
    assert rows.get("probability") == (None if probability is None else "0.875")
    assert rows.get("known") == (None if probability is None else "no")
    assert rows["too fast"] == "yes"
    assert "forgotten" not in rows


def test_no_match_is_shown_as_unanswered() -> None:
    rows = Page(Match(UNANSWERED, 0.0)._repr_html_()).rows
    assert rows == {"place": "unanswered", "score": "0"}
