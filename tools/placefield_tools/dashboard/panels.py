"""The panels of the live page that show an answer; each updates only what has changed."""

import time
from typing import Protocol

from nicegui import ui

from placefield.bus.message import Header
from placefield.bus.messages import SmoothedMessage
from placefield.fusion.match import FASTER
from placefield.maps.geography import Origin
from placefield_tools.common.certainty import percent
from placefield_tools.common.place_words import place_words
from placefield_tools.dashboard import drawings
from placefield_tools.dashboard.charts import certainty_chart, set_certainty
from placefield_tools.dashboard.site import Site, card, chart, svg
from placefield_tools.dashboard.state import Answer

LOOK_BACK = 200
"""Number of frames in the picture of distances and in the curves."""

_TRAIL = 40  # frames
_STARTED = (
    f"{time.time_ns():x}"  # keeps browsers from showing a cached picture of an earlier dashboard
)


class AnswerPanel(Protocol):
    """A panel that shows a part of an answer."""

    def show(self, answer: Answer) -> None:
        """Show an answer."""


class FramesPanel:
    """The query frame beside the place that it matches."""

    def __init__(self, site: Site) -> None:
        self._site = site
        with card("Query and reference", "two-thirds"), ui.element("div").classes("pair"):
            self._query, self._query_caption = _figure("query")
            self._reference, self._reference_caption = _figure("reference")

    def show(self, answer: Answer) -> None:
        """Show an answer."""
        sequence, place = answer.header.sequence, answer.match.place
        has_images = self._site.placemap.places.has_thumbnails
        kept = has_images and self._site.state.frame(answer) is not None
        _set_image(
            self._query,
            f"/frame/{answer.number}.jpg?{_STARTED}" if kept else None,
            f"Query frame {sequence}",
        )
        self._query_caption.text = f"query, frame {sequence}" + self._why_none(kept)
        there = 0 <= place < self._site.placemap.places.count
        _set_image(
            self._reference,
            f"/place/{place}.jpg?{self._site.placemap.digest}" if there and has_images else None,
            f"Reference frame of {place_words(place, self._site.placemap.graph)}",
        )
        named = place_words(place, self._site.placemap.graph)
        words = f"reference, {named}" if place >= 0 else named
        self._reference_caption.text = words if there or place < 0 else f"{words}: of another map"

    def _why_none(self, kept: bool) -> str:
        """Return why the query frame is not shown, as the end of its caption."""
        if kept:
            return ""
        return ": not kept" if self._site.placemap.places.has_thumbnails else ": a descriptor"


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


class MatchPanel:
    """The verdict and its numbers."""

    def __init__(self, site: Site) -> None:
        self._origin, self._graph = Origin.of_frame(site.placemap.pose_frame), site.placemap.graph
        with card("Match", "third"):
            self._warning = (
                ui.label("").classes("warning").props("role=status data-shown=missing-services")
            )
            self._verdict = ui.label("waiting").classes("verdict")
            self._verdict.props("role=status data-shown=verdict")
            with ui.element("dl"):
                self._place = _fact("place")
                self._probability = _fact("probability")
                self._score = _fact("score")
                self._frames = _fact("frames")
                self._pose = _fact("pose")
                self._missing = _fact("missing")
                self._smoothed = _fact("smoothed")

    def show(self, answer: Answer) -> None:
        """Show an answer."""
        match = answer.match
        self._verdict.text = answer.verdict
        self._verdict.classes(replace=f"verdict {answer.verdict.replace(' ', '-')}")
        named = place_words(match.place, self._graph).removeprefix("place ")
        self._place.text = "none" if match.place < 0 else named
        probability = match.probability
        self._probability.text = "none" if probability is None else percent(probability)
        self._score.text = f"{match.score:.2f}"
        self._frames.text = str(answer.header.sequence + 1)
        self._pose.text = self._where(answer)
        channels = ", ".join(map(str, match.missing))
        self._missing.text = f"channels {channels}" if channels else "no channel"

    def show_smoothed(self, header: Header, match: SmoothedMessage) -> None:
        """Show the newest smoothed match."""
        parts = [f"frame {header.sequence + 1}: {place_words(match.place, self._graph)}"]
        if match.probability is not None:
            parts.append(percent(match.probability))
        if match.too_fast:
            parts.append(FASTER)
        self._smoothed.text = ", ".join([*parts, f"{match.lag} frames later"])

    def warn(self, words: str) -> None:
        """Show a warning about the run; empty text hides it."""
        self._warning.text = words

    def _where(self, answer: Answer) -> str:
        if answer.match.pose is None:
            return "none"
        x, y, _ = answer.match.pose
        if self._origin is not None:
            latitude, longitude = self._origin.to_degrees(x, y)
            return f"{latitude:.6f}°, {longitude:.6f}°"
        return f"x {x:.1f} m, y {y:.1f} m"


def _fact(name: str) -> ui.label:
    with ui.element("div"):
        ui.html(name, sanitize=False, tag="dt")
        with ui.element("dd"):
            return ui.label("–").props(f"data-shown={name}")


class CertaintyPanel:
    """Probability and score of the last frames."""

    def __init__(self, site: Site) -> None:
        self._state = site.state
        with card("Certainty of the last frames", "two-thirds"):
            self._chart = chart(certainty_chart(), "Probability and score of the last frames")

    def show(self, answer: Answer) -> None:
        """Show an answer and the answers before it."""
        frames = [
            (one.header.sequence, one.match.score, one.match.probability, one.match.known)
            for one in self._state.before(answer, LOOK_BACK)
        ]
        set_certainty(self._chart.options, frames)
        self._chart.update()


class MatrixPanel:
    """The distances of the last frames to all places, with the matches drawn in."""

    def __init__(self, site: Site) -> None:
        self._state, self._count = site.state, site.placemap.places.count
        with card("Distances and matches", "third"):
            with ui.element("div").classes("matrix"):
                self._picture = ui.element("img").props('alt="no distances yet" data-shown=matrix')
                self._path = ui.html("", sanitize=False)
            ui.label(
                f"last {LOOK_BACK} frames to the right, {self._count} places upwards; "
                "small distances are dark, matches are coloured"
            ).classes("quiet")

    def show(self, answer: Answer) -> None:
        """Show those up to an answer's."""
        self._picture.props["src"] = f"/distances/{answer.number}.png?{_STARTED}"
        last = answer.header.sequence
        self._picture.props["alt"] = (
            f"Distances of the {LOOK_BACK} frames up to {last} to all places, with the matches"
        )
        column = LOOK_BACK - 1 - last
        places = [
            (one.header.sequence + column, one.match.place, bool(one.match.known))
            for one in self._state.before(answer, LOOK_BACK)
            if 0 <= one.match.place < self._count
        ]
        path = drawings.path_drawing(places, LOOK_BACK, self._count)
        self._path.content = svg(path, 100, 100, "", stretch=True)


class RoutePanel:
    """Where on the route the match is."""

    def __init__(self, site: Site) -> None:
        self._state, self._places = site.state, site.placemap.places
        poses = self._places.poses
        self._route = drawings.RouteDrawing.of(poses, self._places.count)
        with card("Route", "third"):
            with ui.element("div").classes("layers route-map"):
                ui.html(self._svg(self._route.inside, "The route"), sanitize=False)
                self._here = ui.html("", sanitize=False)
            bar = f"bar: {self._route.bar_m:g} m; x to the right, y upwards"
            words = bar if len(poses) else "the map has no poses: first place at the left"
            ui.label(words).classes("quiet")

    def _svg(self, inside: str, words: str) -> str:
        return svg(inside, self._route.width, self._route.height, words)

    def show(self, answer: Answer) -> None:
        """Show an answer and the answers before it."""
        place = answer.match.place
        if not 0 <= place < self._places.count:
            self._here.content = ""
            return
        recent = [
            one.match.place
            for one in self._state.before(answer, _TRAIL)
            if 0 <= one.match.place < self._places.count
        ]
        self._here.content = self._svg(self._route.match(place, recent), f"At place {place}")
