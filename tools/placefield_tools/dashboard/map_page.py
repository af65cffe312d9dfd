"""The map builder's page: how each channel cut the route, what it learned, and the places."""

from collections.abc import Callable

import numpy as np
from nicegui import ui

from placefield.maps.map import MapChannel
from placefield_tools.dashboard.charts import curves_chart, scales_chart
from placefield_tools.dashboard.drawings import FIELD_HEIGHT, segments_drawing
from placefield_tools.dashboard.fields import Window, window_around
from placefield_tools.dashboard.page import page
from placefield_tools.dashboard.site import Site, card, chart, svg
from placefield_tools.inspect.map_facts import map_facts

_PER_PAGE = 48
_WHOLE_ROUTE = 4000  # places; longer routes are drawn in parts
_NO_CURVE = (
    "No validation curve: nothing was learned. A metric is learned where another traverse shows "
    "that it helps: placefield build FIRST SECOND"
)


def map_page(site: Site) -> None:
    """Lay out the page for one viewer."""
    with page(site, "Map"):
        _facts(site)
        _scales(site)
        encoding = _Encoding(site)
        _curves(site)
        _Places(site, encoding.show)


def _facts(site: Site) -> None:
    with card("The map", "half"), ui.element("dl"):
        for name, fact in map_facts(site.placemap).items():
            with ui.element("div"):
                ui.html(name, sanitize=False, tag="dt")
                with ui.element("dd"):
                    ui.label(fact)


def _scales(site: Site) -> None:
    with card("Segments by scale, frames", "half"):
        chart(scales_chart(site.placemap.channels), "How many segments each channel has by scale")


class _Encoding:
    """The segments of each channel along the route; a long route is shown in parts."""

    def __init__(self, site: Site) -> None:
        self._count = site.placemap.places.count
        self._channels = site.placemap.channels
        with card("Encoding: segments along the route, the longer the higher", "encoding"):
            self._bars = [
                _encoding_row(number, channel) for number, channel in enumerate(self._channels)
            ]
            self._words = ui.label("").classes("quiet")

    def show(self, place: int) -> None:
        """Show the part that contains a place."""
        whole = self._count <= _WHOLE_ROUTE
        window = Window(0, self._count) if whole else window_around(place, self._count)
        for number, (channel, bars) in enumerate(zip(self._channels, self._bars, strict=True)):
            drawn = segments_drawing(channel, window)
            words = f"Segments of channel {number}"
            bars.content = svg(drawn, window.size, FIELD_HEIGHT, words, stretch=True)
        self._words.text = f"places {window.first} to {window.end - 1}"


def _encoding_row(number: int, channel: MapChannel) -> ui.html:
    active = float(np.mean(channel.labels > 0))
    learned = "a learned metric" if channel.metric.learned else "no learned metric"
    scales = channel.scales
    with ui.element("div").classes("field"):
        with ui.element("div"):
            ui.label(f"channel {number}").classes("strong")
            ui.label(f"segments of {scales[0]} to {scales[-1]} frames")
        with ui.element("div").classes("layers"):
            bars = ui.html("", sanitize=False)
        ui.label(f"{len(channel.segments)} segments, {active:.0%} of the route active, {learned}")
    return bars


def _curves(site: Site) -> None:
    with card("Validation of the metric while it was learned", ""):
        curves = curves_chart(site.placemap.channels)
        if curves is None:
            ui.label(_NO_CURVE).props("data-shown=no-curve")
            return
        chart(curves, "Validation loss and gate score of each channel by step")
        words = "by step; solid: loss of held-back frames, left; dashed: the gate's score, right"
        ui.label(words).classes("quiet")


class _Places:
    """The places' thumbnails, a page at a time."""

    def __init__(self, site: Site, on_turn: Callable[[int], None]) -> None:
        """Show the first page; ``on_turn`` is called with the first place of each further page."""
        self._places, self._digest = site.placemap.places, site.placemap.digest
        self._on_turn = on_turn
        pages = -(-self._places.count // _PER_PAGE)
        with card("Places", ""):
            pager = ui.pagination(1, pages, direction_links=True, value=1)
            pager.props('max-pages=5 aria-label="Pages of places" data-shown=pager')
            pager.on_value_change(lambda change: self._turn_to(change.value))
            self._grid = ui.element("div").classes("places")
        self._turn_to(1)

    def _turn_to(self, number: int) -> None:
        first = (number - 1) * _PER_PAGE
        self._on_turn(first)
        self._grid.clear()
        with self._grid:
            for place in range(first, min(first + _PER_PAGE, self._places.count)):
                self._show_place(place)

    def _show_place(self, place: int) -> None:
        pose = self._places.pose(place)
        where = "" if pose is None else f" · {round(pose[0])}, {round(pose[1])} m"
        with ui.element("figure"):
            if self._places.has_thumbnails:
                image = ui.element("img").props(f'loading=lazy alt="Place {place}"')
                image.props["src"] = f"/place/{place}.jpg?{self._digest}"
            ui.html(f"{place}{where}", sanitize=False, tag="figcaption")
