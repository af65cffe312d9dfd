"""The panels of the live page below its first row; each updates only what has changed."""

from collections.abc import Sequence
from typing import NamedTuple

from nicegui import ui

from placefield_tools.common.natural_sort import counted
from placefield_tools.dashboard import drawings
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.certainty_drawing import HEIGHT, certainty_drawing, score_range
from placefield_tools.dashboard.columns import LOOK_BACK, Columns, LookBack
from placefield_tools.dashboard.first_row import STARTED
from placefield_tools.dashboard.marks import KEY, marks_drawing
from placefield_tools.dashboard.site import Site, card, svg
from placefield_tools.dashboard.verdict import Kind, kind_of

_LISTED = 3  # stretches, and corrections


class CertaintyPanel:
    """Probabilities and score of the last frames, at once and smoothed."""

    def __init__(self, site: Site, columns: Columns) -> None:
        self._state, self._precision, self._columns = site.state, site.precision, columns
        with card("Certainty of the last frames", "two-thirds"):
            with ui.element("div").classes("plot"):
                with ui.element("div").classes("scale quiet"):
                    for share in ("100 %", "50 %", "0 %"):
                        ui.label(share)
                with ui.element("div").classes("certainty") as drawing:
                    self._drawing = ui.html("", sanitize=False)
                drawing.props("data-shown=certainty")
            with ui.element("div").classes("key quiet"):
                ui.html(KEY, sanitize=False)
                self._words = ui.label("no frame yet")
        columns.look_back_on_click(drawing)

    def show(self, answer: Answer) -> None:
        """Show an answer and the answers before it."""
        frames = [
            (self._columns.of(one), one.match, self._state.smoothed(one))
            for one in self._columns.around(answer)
        ]
        drawn = certainty_drawing(frames, LOOK_BACK, self._precision)
        drawn += drawings.column_drawing(self._columns.of(answer), HEIGHT)
        words = "Probabilities and scores of the last frames"
        self._drawing.content = svg(drawn, LOOK_BACK, HEIGHT, words, stretch=True)
        lowest, highest = score_range(frames) or (0.0, 0.0)
        self._words.text = (
            f"{self._columns.words}. Blue: at once; green: with later frames; dashed: the "
            f"{100 * self._precision:g} % asked; grey: score, {lowest:.3g} to {highest:.3g}"
        )


class LostPanel:
    """When the vehicle was not known, and what later frames corrected."""

    def __init__(self, site: Site, look_back: LookBack) -> None:
        self._state, self._graph = site.state, site.placemap.graph
        with card("Not known, and corrected by later frames", "third"):
            self._lost = _FrameList("lost", look_back)
            self._words = ui.label("no frame yet").props("data-shown=corrected")
            self._corrections = _FrameList("correction", look_back)

    def show(self, answer: Answer) -> None:
        """Show the last stretches and corrections of the stream."""
        summary = self._state.summary
        if summary is None:
            return
        frames = counted(summary.frames, "frame")
        self._words.text = f"later frames corrected {summary.corrected or 'none'} of {frames}"
        self._lost.show(
            [_Listed(one.middle, one.words(), one.kind) for one in list(summary.lost)[-_LISTED:]]
        )
        self._corrections.show(
            [
                _Listed(one.header.sequence, one.words(self._graph), "plain")
                for one in list(summary.corrections)[-_LISTED:]
            ]
        )


class _Listed(NamedTuple):
    """A frame to look back to, in words, and how it is marked."""

    frame: int
    words: str
    kind: Kind


class _FrameList:
    """Frames in words, the newest first; a click looks back to one.

    The buttons stay, and only their words change: a click on a replaced button would be lost.
    """

    def __init__(self, shown: str, look_back: LookBack) -> None:
        self._look_back = look_back
        self._listed: list[_Listed] = []
        with ui.element("div").classes("stretches"):
            self._rows = [self._row(rank, shown) for rank in range(_LISTED)]

    def _row(self, rank: int, shown: str) -> tuple[ui.button, ui.label]:
        button = ui.button(on_click=lambda: self._look_back(self._listed[rank].frame))
        button.props(f"flat no-caps align=left data-shown={shown}-{rank}").set_visibility(False)
        with button:
            return button, ui.label("")

    def show(self, listed: Sequence[_Listed]) -> None:
        """Show at most ``_LISTED`` frames, given oldest first."""
        self._listed = [*reversed(listed)]
        for (_, label), one in zip(self._rows, self._listed, strict=False):
            label.text = one.words
            label.classes(replace=f"mark {one.kind}")
        for rank, (button, _) in enumerate(self._rows):
            button.set_visibility(rank < len(listed))


class MatrixPanel:
    """The distances of the last frames to all places, with the matches drawn in."""

    def __init__(self, site: Site, columns: Columns) -> None:
        self._state, self._columns = site.state, columns
        self._count = site.placemap.places.count
        with card("Distances and matches", "third"):
            matrix = ui.element("div").classes("matrix")
            with matrix:
                self._picture = ui.element("img").props('alt="no distances yet" data-shown=matrix')
                self._path = ui.html("", sanitize=False)
            with ui.element("div").classes("key quiet"):
                ui.html(KEY, sanitize=False)
                self._words = ui.label("no frame yet")
        columns.look_back_on_click(matrix)

    def show(self, answer: Answer) -> None:
        """Show those up to an answer's."""
        answers = self._columns.around(answer)
        newest = self._columns.newest or answer
        self._picture.props["src"] = f"/distances/{newest.number}.png?{STARTED}"
        self._picture.props["alt"] = "Distances of the last frames to all places, and the matches"
        self._words.text = (
            f"{self._columns.words}; {self._count} places, upwards. Small distances are dark. "
            "Green: with later frames"
        )
        at_once = [(one, one.match.place, kind_of(one.match)) for one in answers]
        smoothed = [(one, self._state.smoothed(one)) for one in answers]
        later = [
            (one, match.place, "smoothed")
            for one, match in smoothed
            if match is not None and match.known and match.place != one.match.place
        ]
        path = marks_drawing(
            (self._columns.of(one) + 0.5, 100 * (1 - (place + 0.5) / self._count), kind)
            for one, place, kind in [*at_once, *later]
            if 0 <= place < self._count
        )
        path += drawings.column_drawing(self._columns.of(answer), 100)
        self._path.content = svg(path, LOOK_BACK, 100, "", stretch=True)
