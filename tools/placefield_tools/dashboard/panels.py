"""The panels of the live page below its first row; each updates only what has changed."""

from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments

from placefield_tools.common.natural_sort import counted
from placefield_tools.dashboard import drawings
from placefield_tools.dashboard.certainty_drawing import HEIGHT, certainty_drawing, score_range
from placefield_tools.dashboard.first_row import STARTED
from placefield_tools.dashboard.site import Site, card, svg
from placefield_tools.dashboard.state import Answer, LiveState

LOOK_BACK = 200
"""Number of frames in the picture of distances and in the curves."""

LookBack = Callable[[int], None]
"""Called with the number of a frame of the shown stream, to look back to it."""

_CORRECTIONS = 5  # that are listed

_SHARE = """(event) => {
    const box = event.currentTarget.getBoundingClientRect();
    emit((event.clientX - box.left) / box.width);
}"""


class CertaintyPanel:
    """Probabilities and score of the last frames, at once and smoothed."""

    def __init__(self, site: Site, look_back: LookBack) -> None:
        self._state, self._precision = site.state, site.precision
        self._columns = _Columns(look_back)
        with card("Certainty of the last frames", "two-thirds"):
            with ui.element("div").classes("plot"):
                with ui.element("div").classes("scale quiet"):
                    for share in ("100 %", "50 %", "0 %"):
                        ui.label(share)
                with ui.element("div").classes("certainty") as drawing:
                    self._drawing = ui.html("", sanitize=False)
                drawing.props("data-shown=certainty")
            self._words = ui.label("no frame yet").classes("quiet")
        self._columns.look_back_on_click(drawing)

    def show(self, answer: Answer) -> None:
        """Show an answer and the answers before it."""
        frames = [
            (self._columns.of(one), one.match, self._state.smoothed(one))
            for one in self._columns.up_to(answer, self._state)
        ]
        drawn = certainty_drawing(frames, LOOK_BACK, self._precision)
        words = "Probabilities and scores of the last frames"
        self._drawing.content = svg(drawn, LOOK_BACK, HEIGHT, words, stretch=True)
        lowest, highest = score_range(frames) or (0.0, 0.0)
        self._words.text = (
            f"{self._columns.words}. Blue: at once, green: smoothed, orange: not known; dashed: "
            f"{100 * self._precision:g} % asked; grey: score, {lowest:.3g} to {highest:.3g}"
        )


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
        self._columns = _Columns(look_back)
        with card("Distances and matches", "third"):
            matrix = ui.element("div").classes("matrix")
            with matrix:
                self._picture = ui.element("img").props('alt="no distances yet" data-shown=matrix')
                self._path = ui.html("", sanitize=False)
            self._words = ui.label("no frame yet").classes("quiet")
        self._columns.look_back_on_click(matrix)

    def show(self, answer: Answer) -> None:
        """Show those up to an answer's."""
        answers = self._columns.up_to(answer, self._state)
        self._picture.props["src"] = f"/distances/{answer.number}.png?{STARTED}"
        self._picture.props["alt"] = "Distances of the last frames to all places, and the matches"
        self._words.text = (
            f"{self._columns.words}, {self._count} places upwards; small distances are dark. "
            "Blue: known, orange: not known, green: smoothed"
        )
        at_once = [
            (one, one.match.place, "sure" if one.match.known else "unsure") for one in answers
        ]
        smoothed = [(one, self._state.smoothed(one)) for one in answers]
        later = [
            (one, match.place, "smoothed")
            for one, match in smoothed
            if match is not None and match.known and match.place != one.match.place
        ]
        dots = [
            (self._columns.of(one), place, kind)
            for one, place, kind in [*at_once, *later]
            if 0 <= place < self._count
        ]
        path = drawings.path_drawing(dots, LOOK_BACK, self._count)
        self._path.content = svg(path, 100, 100, "", stretch=True)


class _Columns:
    """The last frames of a stream, a column each, the newest at the right."""

    def __init__(self, look_back: LookBack) -> None:
        self._look_back, self._last = look_back, 0

    def look_back_on_click(self, drawing: ui.element) -> None:
        """Let a click on a drawing that is as wide as the columns look back to its frame."""

        def clicked(event: GenericEventArguments) -> None:
            self._look_back(self._first + int(float(event.args) * LOOK_BACK))

        drawing.on("click", clicked, js_handler=_SHARE)

    def up_to(self, answer: Answer, state: LiveState) -> list[Answer]:
        """Let an answer's frame be the last column, and return the answers of all columns."""
        self._last = answer.header.sequence
        return state.before(answer, LOOK_BACK)

    def of(self, answer: Answer) -> int:
        """Return the column of an answer."""
        return answer.header.sequence - self._first

    @property
    def words(self) -> str:
        """The columns in words."""
        return f"frames {max(self._first, 0)} to {self._last} to the right"

    @property
    def _first(self) -> int:
        return self._last - LOOK_BACK + 1
