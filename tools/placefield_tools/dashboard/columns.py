"""The last frames of a stream as the columns that the pictures over time share."""

from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments

from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.state import LiveState

LOOK_BACK = 200
"""Number of columns, a frame each."""

LookBack = Callable[[int], None]
"""Called with the number of a frame of the shown stream, to look back to it."""

_SHARE = """(event) => {
    const box = event.currentTarget.getBoundingClientRect();
    emit((event.clientX - box.left) / box.width);
}"""


class Columns:
    """The last frames of a stream, a column each; they stay while one of them is looked at.

    Attributes:
        newest: the answer in the last column.
    """

    def __init__(self, state: LiveState, look_back: LookBack) -> None:
        """Show answers of a state; a click calls ``look_back`` with the frame of its column."""
        self._state, self._look_back = state, look_back
        self.newest: Answer | None = None

    def look_back_on_click(self, drawing: ui.element) -> None:
        """Let a click on a drawing that is as wide as the columns look back to its frame."""

        def clicked(event: GenericEventArguments) -> None:
            self._look_back(self._first + int(float(event.args) * LOOK_BACK))

        drawing.on("click", clicked, js_handler=_SHARE)

    def around(self, answer: Answer) -> list[Answer]:
        """Return the answers of the columns, one of which is this answer."""
        newest = self.newest or answer
        is_same = newest.header.stream == answer.header.stream
        self.newest = newest if is_same and 0 <= self.of(answer) < LOOK_BACK else answer
        return self._state.before(self.newest, LOOK_BACK)

    def of(self, answer: Answer) -> int:
        """Return the column of an answer."""
        return answer.header.sequence - self._first

    @property
    def words(self) -> str:
        """The columns in words."""
        return f"frames {max(self._first, 0)} to {self._last}, left to right"

    @property
    def _first(self) -> int:
        return self._last - LOOK_BACK + 1

    @property
    def _last(self) -> int:
        return self.newest.header.sequence if self.newest else 0
