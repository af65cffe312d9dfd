"""The panels of the live page below its first row; each updates only what has changed."""

from collections.abc import Callable
from functools import partial

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

_LISTED = 3  # stretches, and corrections

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
            for one in self._columns.around(answer, self._state)
        ]
        drawn = certainty_drawing(frames, LOOK_BACK, self._precision)
        drawn += drawings.column_drawing(self._columns.of(answer), HEIGHT)
        words = "Probabilities and scores of the last frames"
        self._drawing.content = svg(drawn, LOOK_BACK, HEIGHT, words, stretch=True)
        lowest, highest = score_range(frames) or (0.0, 0.0)
        self._words.text = (
            f"{self._columns.words}. Blue: at once, green: smoothed, orange: not known; dashed: "
            f"{100 * self._precision:g} % asked; grey: score, {lowest:.3g} to {highest:.3g}"
        )


class LostPanel:
    """When the vehicle was not known, and what later frames corrected."""

    def __init__(self, site: Site, look_back: LookBack) -> None:
        self._state, self._graph, self._look_back = site.state, site.placemap.graph, look_back
        with card("Not known, and corrected by later frames", "third"):
            self._lost = ui.element("div").classes("stretches")
            self._words = ui.label("no frame yet").props("data-shown=corrected")
            self._corrections = ui.element("div").classes("stretches")
        self._shown: object = None

    def show(self, answer: Answer) -> None:
        """Show the last stretches and corrections of the stream."""
        summary = self._state.summary
        if summary is None:
            return
        frames = counted(summary.frames, "frame")
        self._words.text = f"corrected: {summary.corrected or 'none'} of {frames}"
        lost = [(one.words(), one.middle) for one in list(summary.lost)[-_LISTED:]]
        corrections = [
            (one.words(self._graph), one.header.sequence)
            for one in list(summary.corrections)[-_LISTED:]
        ]
        if (lost, corrections) != self._shown:
            self._shown = lost, corrections
            self._list(self._lost, lost, "lost")
            self._list(self._corrections, corrections, "correction")

    def _list(self, within: ui.element, frames: list[tuple[str, int]], shown: str) -> None:
        """List frames by their words, the newest first; a click looks back to one."""
        within.clear()
        with within:
            for words, sequence in reversed(frames):
                button = ui.button(words, on_click=partial(self._look_back, sequence))
                button.props(f"flat no-caps align=left data-shown={shown}")


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
        answers = self._columns.around(answer, self._state)
        newest = self._columns.newest or answer
        self._picture.props["src"] = f"/distances/{newest.number}.png?{STARTED}"
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
        path = drawings.path_drawing(dots, self._count)
        path += drawings.column_drawing(self._columns.of(answer), 100)
        self._path.content = svg(path, LOOK_BACK, 100, "", stretch=True)


class _Columns:
    """The last frames of a stream, a column each; they stay while one of them is looked at.

    Attributes:
        newest: the answer in the last column.
    """

    def __init__(self, look_back: LookBack) -> None:
        self._look_back = look_back
        self.newest: Answer | None = None

    def look_back_on_click(self, drawing: ui.element) -> None:
        """Let a click on a drawing that is as wide as the columns look back to its frame."""

        def clicked(event: GenericEventArguments) -> None:
            self._look_back(self._first + int(float(event.args) * LOOK_BACK))

        drawing.on("click", clicked, js_handler=_SHARE)

    def around(self, answer: Answer, state: LiveState) -> list[Answer]:
        """Return the answers of the columns, one of which is this answer."""
        newest = self.newest or answer
        is_same = newest.header.stream == answer.header.stream
        self.newest = newest if is_same and 0 <= self.of(answer) < LOOK_BACK else answer
        return state.before(self.newest, LOOK_BACK)

    def of(self, answer: Answer) -> int:
        """Return the column of an answer."""
        return answer.header.sequence - self._first

    @property
    def last(self) -> int:
        """The number of the frame in the last column."""
        return self.newest.header.sequence if self.newest else 0

    @property
    def words(self) -> str:
        """The columns in words."""
        return f"frames {max(self._first, 0)} to {self.last} to the right"

    @property
    def _first(self) -> int:
        return self.last - LOOK_BACK + 1
