"""The first row of the live page: where the vehicle is, how certain that is, and what it sees."""

import time
from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments

from placefield.fusion.match import FASTER
from placefield.maps.geography import Origin
from placefield_tools.common.certainty import certainty_of, percent
from placefield_tools.common.place_words import place_words
from placefield_tools.dashboard import drawings
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.marks import KEY
from placefield_tools.dashboard.run_state import RunState
from placefield_tools.dashboard.service_words import slowest_in_words
from placefield_tools.dashboard.site import Site, card, svg
from placefield_tools.dashboard.verdict import belief_of, kind_of, verdict_of
from placefield_tools.status.service_status import RunStatus

STARTED = f"{time.time_ns():x}"
"""Keeps browsers from showing a cached picture of an earlier dashboard."""

_HERE = "Where the vehicle is"
_PATH_S = 60.0  # seconds of the path that is drawn
_POINT = """(event) => {
    const drawing = event.currentTarget.querySelector("svg");
    const at = new DOMPoint(event.clientX, event.clientY);
    const point = at.matrixTransform(drawing.getScreenCTM().inverse());
    emit(point.x, point.y);
}"""


class VerdictPanel:
    """What the answer comes to, and what later frames made of it."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._origin, self._graph = Origin.of_frame(site.placemap.pose_frame), site.placemap.graph
        with card(_HERE, "verdict-card") as self._heading:
            self._heading.props("data-shown=verdict-heading")
            self._verdict = ui.label("no frame yet").classes("verdict")
            self._verdict.props("role=status data-shown=verdict")
            with ui.element("dl"):
                self._place = _fact("place")
                self._pose = _fact("position")
                self._smoothed = _fact("later frames say")
                self._services = _fact("slowest service")
            self._note = ui.label("").classes("warning").props("role=status data-shown=note")

    def show_services(self, status: RunStatus, state: RunState) -> None:
        """Name the service that frames wait for."""
        running = slowest_in_words(status) or "none is behind"
        self._services.text = "see above" if state.is_fault else running

    def show_time(self, answer: Answer, *, is_newest: bool, is_current: bool) -> None:
        """Say whether the answer is an earlier one, the last one, or of where the vehicle is."""
        if not is_newest:
            words = f"Where the vehicle was at frame {answer.header.sequence}"
        elif ending := self._site.state.ending:
            words = f"Last match: {ending}"
        else:
            words = _HERE if is_current else "Last match: no newer one can come"
        self._heading.content = words

    def show(self, answer: Answer) -> None:
        """Show an answer."""
        match = answer.match
        verdict = verdict_of(answer, self._site.precision)
        self._verdict.text = verdict.words
        self._verdict.classes(replace=f"verdict mark {verdict.kind}")
        named = place_words(match.place, self._graph).removeprefix("place ")
        guess = " (best guess)" if match.known is False else ""
        self._place.text = "none" if match.place < 0 else f"{named}{guess}"
        self._pose.text = self._where(answer)
        self._smoothed.text = self._later(answer)
        channels = ", ".join(map(str, match.missing))
        self._note.text = f"without channels {channels}" if channels else ""

    def _later(self, answer: Answer) -> str:
        """Say what later frames made of this frame's match."""
        smoothed = self._site.state.smoothed(answer)
        if smoothed is None:
            return "nothing yet"
        if smoothed.too_fast:
            return FASTER
        same = 0 <= smoothed.place == answer.match.place
        place = "the same place" if same else place_words(smoothed.place, self._graph)
        parts = ["unknown" if certainty_of(smoothed) == "unknown" else place]
        if smoothed.probability is not None:
            parts.append(percent(smoothed.probability))
        return ", ".join(parts)

    def _where(self, answer: Answer) -> str:
        if answer.match.pose is None:
            return "the map has no poses" if not len(self._site.placemap.places.poses) else "none"
        x, y, _ = answer.match.pose
        if self._origin is not None:
            latitude, longitude = self._origin.to_degrees(x, y)
            return f"{latitude:.6f}°, {longitude:.6f}°"
        return f"x {x:.1f} m, y {y:.1f} m"


def _fact(name: str) -> ui.label:
    with ui.element("div"):
        ui.html(name, sanitize=False, tag="dt")
        with ui.element("dd"):
            return ui.label("–").props(f'data-shown="{name}"')


class RoutePanel:
    """The route with the vehicle, the belief in each place, and the path of the last minute."""

    def __init__(self, site: Site, look_back_to: Callable[[int], None]) -> None:
        """Draw the route; a click calls ``look_back_to`` with the place nearest to it."""
        self._state, self._places = site.state, site.placemap.places
        poses = self._places.poses
        self._route = drawings.RouteDrawing.of(poses, self._places.count)
        with card("Route", "route-card"):
            layers = ui.element("div").classes("layers route-map").props("data-shown=route")
            with layers:
                ui.html(self._svg(self._route.inside, "The route"), sanitize=False)
                self._here = ui.html("", sanitize=False)
            bar = f"bar: {self._route.bar_m:g} m"
            words = bar if self._route.bar_m else f"places 0 to {self._places.count - 1}"
            with ui.element("div").classes("key quiet"):
                ui.html(KEY, sanitize=False)
                ui.label(f"green: how likely each place is · {words} · click: when was it there?")

        def clicked(event: GenericEventArguments) -> None:
            place = self._route.nearest(*map(float, event.args))
            if place is not None:
                look_back_to(place)

        layers.on("click", clicked, js_handler=_POINT)

    def _svg(self, inside: str, words: str) -> str:
        return svg(inside, self._route.width, self._route.height, words)

    def show(self, answer: Answer) -> None:
        """Show an answer and the answers before it."""
        place, count = answer.match.place, self._places.count
        drawn = self._route.belief(*belief_of(answer))
        recent = [
            one.match.place
            for one in self._state.last_seconds(answer, _PATH_S)
            if one.match.known is not False and 0 <= one.match.place < count
        ]
        if 0 <= place < count:
            drawn += self._route.match(place, recent, kind_of(answer.match))
        self._here.content = self._svg(drawn, f"At place {place}")


class FramesPanel:
    """The query frame beside the place that it matches."""

    def __init__(self, site: Site) -> None:
        self._site = site
        with card("Query and reference", "frames-card"), ui.element("div").classes("pair"):
            self._query, self._query_caption = _figure("query")
            self._reference, self._reference_caption = _figure("reference")

    def show(self, answer: Answer) -> None:
        """Show an answer."""
        sequence, place = answer.header.sequence, answer.match.place
        has_images = self._site.placemap.places.has_thumbnails
        kept = has_images and self._site.state.frame(answer) is not None
        _set_image(
            self._query,
            f"/frame/{answer.number}.jpg?{STARTED}" if kept else None,
            f"Query frame {sequence}",
        )
        self._query_caption.text = f"query, frame {sequence}" + self._why_none(kept)
        there = 0 <= place < self._site.placemap.places.count
        named = place_words(place, self._site.placemap.graph)
        _set_image(
            self._reference,
            f"/place/{place}.jpg?{self._site.placemap.digest}" if there and has_images else None,
            f"Reference frame of {named}",
        )
        words = f"reference, {named}" if place >= 0 else named
        self._reference_caption.text = words if there or place < 0 else f"{words}: of another map"

    def _why_none(self, kept: bool) -> str:
        """Return why the query frame is not shown, as the end of its caption."""
        if kept:
            return ""
        has_images = self._site.placemap.places.has_thumbnails
        return ": the image is not kept" if has_images else ": a descriptor, no image"


def _figure(name: str) -> tuple[ui.element, ui.label]:
    with ui.element("figure"):
        with ui.element("div").classes("frame"):
            image = ui.element("img").props(f'alt="no {name} yet" data-shown={name}')
        caption = ui.label(f"no {name} yet")
    return image, caption


def _set_image(image: ui.element, source: str | None, words: str) -> None:
    if source is None:
        image.props.pop("src", None)
    else:
        image.props["src"] = source
    image.props["alt"] = words if source else "nothing"
