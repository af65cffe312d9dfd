"""The panel of the live page that shows each channel's answer."""

from nicegui import ui

from placefield.maps.map import MapChannel
from placefield_tools.common.certainty import percent
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.drawings import (
    FIELD_HEIGHT,
    firing_drawing,
    match_drawing,
    segments_drawing,
)
from placefield_tools.dashboard.fields import Window, firing_segment, window_around
from placefield_tools.dashboard.site import Site, card, svg


class FieldsPanel:
    """Each channel's segments by scale, its active segment and its evidence."""

    def __init__(self, site: Site) -> None:
        self._count = site.placemap.places.count
        with card("Channels", "two-thirds"):
            self._rows = [
                _Row(number, channel) for number, channel in enumerate(site.placemap.channels)
            ]
            self._words = ui.label("").classes("quiet")

    def show(self, answer: Answer) -> None:
        """Show an answer."""
        place = min(max(answer.match.place, 0), self._count - 1)
        window = window_around(place, self._count)
        for row in self._rows:
            row.show(answer, window)
        self._words.text = (
            f"places {window.first} to {window.end - 1}, left to right. Bars: segments, the longer "
            "the higher; purple: the active segment, and the belief below; dashed: the match"
        )


class _Row:
    """The drawing of one channel."""

    def __init__(self, number: int, channel: MapChannel) -> None:
        self._number, self._channel = number, channel
        self._window: Window | None = None
        scales = channel.scales
        with ui.element("div").classes("field"):
            with ui.element("div"):
                ui.label(f"channel {number}").classes("strong")
                ui.label(f"segments of {scales[0]} to {scales[-1]} frames")
            with ui.element("div").classes("layers"):
                self._segments = ui.html("", sanitize=False)
                self._firing = ui.html("", sanitize=False)
            self._words = ui.label("no frame yet").props(f"data-shown=channel-{number}")

    def show(self, answer: Answer, window: Window) -> None:
        if window != self._window:
            self._window = window
            bars = segments_drawing(self._channel, window)
            words = f"Segments of channel {self._number} by scale"
            self._segments.content = svg(bars, window.size, FIELD_HEIGHT, words, stretch=True)
        candidate = answer.candidates.get(self._number)
        drawn = match_drawing(answer.match.place, window)
        if candidate is None:
            self._words.text = "no answer"
        elif candidate.place < 0:
            self._words.text = "no place"
        else:
            drawn += firing_drawing(self._channel, candidate, answer.rule, window)
            score = candidate.score
            certain = (
                f"belief {percent(score)}" if answer.rule == "filter" else f"score {score:.3g}"
            )
            self._words.text = f"{self._field(candidate.place)} · {certain}"
        self._firing.content = svg(drawn, window.size, FIELD_HEIGHT, "", stretch=True)

    def _field(self, place: int) -> str:
        fires = firing_segment(self._channel, place)
        if fires is None:
            return f"place {place}, in no segment"
        first, end = fires
        return f"place {place}, segment {first} to {end - 1}"
