"""The panels of the live page below its first row; each updates only what has changed."""

from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments

from placefield_tools.common.natural_sort import counted
from placefield_tools.dashboard import drawings
from placefield_tools.dashboard.charts import certainty_chart, set_certainty
from placefield_tools.dashboard.first_row import STARTED
from placefield_tools.dashboard.site import Site, card, chart, svg
from placefield_tools.dashboard.state import Answer

LOOK_BACK = 200
"""Number of frames in the picture of distances and in the curves."""

LookBack = Callable[[int], None]
"""Called with the number of a frame of the shown stream, to look back to it."""

_CORRECTIONS = 5  # that are listed

_SHARE = """(event) => {
    const box = event.currentTarget.getBoundingClientRect();
    emit((event.clientX - box.left) / box.width);
}"""
_FRAME = """(event) => {
    const box = event.currentTarget.getBoundingClientRect();
    const point = [event.clientX - box.left, event.clientY - box.top];
    emit(getElement(%d).chart.convertFromPixel({gridIndex: 0}, point)[0]);
}"""


class CertaintyPanel:
    """Probabilities and score of the last frames, at once and smoothed."""

    def __init__(self, site: Site, look_back: LookBack) -> None:
        self._state = site.state
        with card("Certainty of the last frames", "two-thirds"):
            words = "Probabilities and score of the last frames"
            self._chart = chart(certainty_chart(site.precision), words)

        def clicked(event: GenericEventArguments) -> None:
            look_back(round(float(event.args)))

        self._chart.on("click", clicked, js_handler=_FRAME % self._chart.id)
        self._chart.props("data-shown=certainty")

    def show(self, answer: Answer) -> None:
        """Show an answer and the answers before it."""
        frames = [
            (one.header.sequence, one.match, self._state.smoothed(one))
            for one in self._state.before(answer, LOOK_BACK)
        ]
        set_certainty(self._chart.options, frames)
        self._chart.update()


class CorrectionsPanel:
    """The matches that later frames corrected."""

    def __init__(self, site: Site, look_back: LookBack) -> None:
        self._state, self._graph, self._look_back = site.state, site.placemap.graph, look_back
        with card("Corrected by later frames", "third"):
            self._words = ui.label("no frame yet").props("data-shown=corrected")
            self._list = ui.element("div").classes("corrections")
        self._shown = 0

    def show(self, answer: Answer) -> None:
        """Show the last corrections of the stream."""
        summary = self._state.summary
        if summary is None:
            return
        frames = counted(summary.frames, "frame")
        self._words.text = f"{summary.corrected or 'none'} of {frames}"
        last = list(summary.corrections)[-_CORRECTIONS:]
        newest = id(last[-1]) if last else 0
        if newest == self._shown:
            return
        self._shown = newest
        self._list.clear()
        with self._list:
            for correction in reversed(last):
                sequence = correction.header.sequence
                button = ui.button(
                    correction.words(self._graph),
                    on_click=lambda sequence=sequence: self._look_back(sequence),
                )
                button.props("flat no-caps align=left data-shown=correction")


class MatrixPanel:
    """The distances of the last frames to all places, with the matches drawn in."""

    def __init__(self, site: Site, look_back: LookBack) -> None:
        self._state, self._count = site.state, site.placemap.places.count
        self._last = 0
        with card("Distances and matches", "third"):
            matrix = ui.element("div").classes("matrix")
            with matrix:
                self._picture = ui.element("img").props('alt="no distances yet" data-shown=matrix')
                self._path = ui.html("", sanitize=False)
            ui.label(
                f"last {LOOK_BACK} frames to the right, {self._count} places upwards; small "
                "distances are dark. Blue: known, orange: not known, green: smoothed"
            ).classes("quiet")

        def clicked(event: GenericEventArguments) -> None:
            column = int(float(event.args) * LOOK_BACK)
            look_back(self._last - LOOK_BACK + 1 + column)

        matrix.on("click", clicked, js_handler=_SHARE)

    def show(self, answer: Answer) -> None:
        """Show those up to an answer's."""
        self._picture.props["src"] = f"/distances/{answer.number}.png?{STARTED}"
        self._last = answer.header.sequence
        self._picture.props["alt"] = (
            f"Distances of the {LOOK_BACK} frames up to {self._last} to all places, and the matches"
        )
        answers = self._state.before(answer, LOOK_BACK)
        at_once = [
            (one.header.sequence, one.match.place, "sure" if one.match.known else "unsure")
            for one in answers
        ]
        smoothed = [(one, self._state.smoothed(one)) for one in answers]
        later = [
            (one.header.sequence, match.place, "smoothed")
            for one, match in smoothed
            if match is not None and match.known and match.place != one.match.place
        ]
        first = self._last - LOOK_BACK + 1
        dots = [
            (frame - first, place, kind)
            for frame, place, kind in [*at_once, *later]
            if 0 <= place < self._count
        ]
        path = drawings.path_drawing(dots, LOOK_BACK, self._count)
        self._path.content = svg(path, 100, 100, "", stretch=True)
