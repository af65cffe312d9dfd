"""The live page: the newest answer, or an earlier one to look at."""

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from nicegui import ui
from nicegui.events import GenericEventArguments, KeyEventArguments

from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.banner import Banner
from placefield_tools.dashboard.columns import Columns
from placefield_tools.dashboard.field_panel import FieldsPanel
from placefield_tools.dashboard.first_row import FramesPanel, RoutePanel, VerdictPanel
from placefield_tools.dashboard.panels import CertaintyPanel, LostPanel, MatrixPanel
from placefield_tools.dashboard.run_state import run_state
from placefield_tools.dashboard.service_panels import HealthPanel, ReplayPanel
from placefield_tools.dashboard.site import Site, page

_DRAW_EVERY_S = 0.1
_STATUS_EVERY_S = 1.0  # services report as often
_WHEN_DRAWN = "return new Promise(drawn => requestAnimationFrame(() => drawn(true)))"
_PATIENCE_S = 10.0
_KEEP_STILL = """(pressed) => {
    const taken = [" ", "ArrowLeft", "ArrowRight", "Home", "End"].includes(pressed.key);
    if (taken && !pressed.ctrlKey && !pressed.altKey && !pressed.metaKey)
        pressed.event.preventDefault();
}"""  # the browser would scroll the page by these keys, away from what they show
_FAR = 10  # frames that a step takes with the shift key


def live_page(site: Site) -> None:
    """Lay out the page for one viewer."""
    with page(site, "Live") as board:
        LivePage(site, board)


class AnswerPanel(Protocol):
    """A panel that shows a part of an answer."""

    def show(self, answer: Answer) -> None:
        """Show an answer."""


class LivePage:
    """One browser's view of the run: it follows, or is paused at an answer."""

    def __init__(self, site: Site, board: ui.element) -> None:
        """Fill the page's main part; it is ``stale`` while no match can come."""
        self._site, self._state, self._board = site, site.state, board
        self._placemap = site.placemap
        self._paused_at: Answer | None = None
        self._shown: tuple[Answer, object] | None = None
        self._banner = Banner(site)
        with ui.element("div").classes("first"):
            first = (
                VerdictPanel(site),
                RoutePanel(site, self._look_back_to_place),
                FramesPanel(site),
            )
        self._lay_out_controls()
        columns = Columns(self._state, self._look_back_to_frame)
        self._panels: list[AnswerPanel] = [
            *first,
            CertaintyPanel(site, columns),
            LostPanel(site, self._look_back_to_frame),
            FieldsPanel(site),
            MatrixPanel(site, columns),
        ]
        self._health = HealthPanel(site)
        self._replay = ReplayPanel(site, self._stop)
        self._draw_status()
        ui.timer(_DRAW_EVERY_S, self._draw_in_turn)
        ui.timer(_STATUS_EVERY_S, self._draw_status)

    def _lay_out_controls(self) -> None:
        section = ui.element("section").classes("card").props('aria-label="Time"')
        with section, ui.element("div").classes("controls"):
            self._pause = ui.button("Pause", on_click=self._pause_or_follow)
            self._pause.props("unelevated no-caps data-shown=pause")
            self._pause.props('title="Space"')
            ui.button(icon="chevron_left", on_click=lambda: self._step(-1)).props(
                'flat round aria-label="One frame back" title="Left arrow; with shift: ten frames"'
            )
            ui.button(icon="chevron_right", on_click=lambda: self._step(1)).props(
                'flat round aria-label="One frame on" title="Right arrow; with shift: ten frames"'
            )
            self._slider = ui.slider(min=0, max=1, value=1).props(
                'aria-label="Look back over the last answers" data-shown=slider'
            )
            self._slider.on("update:model-value", self._look_back, throttle=0.05)
            self._moment = ui.label("no answer yet").classes("moment")
            self._moment.props("data-shown=moment")
            self._stop = ui.button("Stop the replay").props("outline no-caps data-shown=stop")
        ui.keyboard(self._press).on("key", js_handler=_KEEP_STILL)

    def _press(self, pressed: KeyEventArguments) -> None:
        if not pressed.action.keydown:
            return
        far = _FAR if pressed.modifiers.shift else 1
        if pressed.key.space:
            self._pause_or_follow()
        elif pressed.key.arrow_left:
            self._step(-far)
        elif pressed.key.arrow_right:
            self._step(far)
        elif pressed.key.home and self._state.answers:
            self._pause_at(self._state.answers[0])
        elif pressed.key.end:
            self._paused_at = None
            self._draw()

    def _pause_or_follow(self) -> None:
        self._paused_at = self._shown[0] if self._shown and self._paused_at is None else None
        self._draw()

    def _look_back(self, moved: GenericEventArguments) -> None:
        self._pause_at(self._state.at(int(moved.args)))

    def _look_back_to_frame(self, sequence: int) -> None:
        """Look back to the shown stream's frame with this number, or the kept one nearest to it."""
        self._look_back_to_nearest(lambda answer: abs(answer.header.sequence - sequence))

    def _look_back_to_place(self, place: int) -> None:
        """Look back to when the vehicle was nearest to a place, the last time."""
        self._look_back_to_nearest(lambda answer: abs(answer.match.place - place))

    def _look_back_to_nearest(self, apart: Callable[[Answer], int]) -> None:
        if self._shown is not None:
            stream = self._shown[0].header.stream
            answers = [one for one in self._state.answers if one.header.stream == stream]
            self._pause_at(min(reversed(answers), key=apart, default=None))

    def _step(self, by: int) -> None:
        if self._shown is not None:
            self._pause_at(self._state.at(self._shown[0].number + by))

    def _pause_at(self, answer: Answer | None) -> None:
        self._paused_at = answer or self._paused_at
        self._draw()

    async def _draw_in_turn(self) -> None:
        """Draw, and wait for the browser: a slow or hidden browser is sent fewer updates."""
        self._draw()
        with suppress(TimeoutError):
            await ui.run_javascript(_WHEN_DRAWN, timeout=_PATIENCE_S)

    def _draw(self) -> None:
        """Draw the changes: another answer, or what later frames made of the last ones."""
        answers = self._state.answers
        if not answers or self._state.placemap is not self._placemap:  # the page is loaded again
            return
        answer = self._paused_at or answers[-1]
        if (answer, self._state.newest_smoothed) != self._shown:
            self._shown = answer, self._state.newest_smoothed
            for panel in self._panels:
                panel.show(answer)
        self._draw_controls(answer)

    def _draw_status(self) -> None:
        """Show the state of the run and its services; grey the match when no newer can come."""
        status = self._site.feed.status()
        state = run_state(
            self._state,
            status,
            connected=self._site.feed.connected,
            commands=self._site.commands,
        )
        self._health.show(status, state)
        self._banner.show(state)
        self._replay.show(is_first=state.name == "idle")
        stale = not state.is_current
        self._board.classes(**({"add": "stale"} if stale else {"remove": "stale"}))

    def _draw_controls(self, answer: Answer) -> None:
        answers, paused = self._state.answers, self._paused_at is not None
        for end, number in (("min", answers[0].number), ("max", answers[-1].number)):
            if self._slider.props[end] != number:  # setting it sends it, whatever it was
                self._slider.props[end] = number
        self._slider.value = max(answer.number, answers[0].number)
        self._pause.text = "Back to live" if paused else "Pause"
        newer = answers[-1].number - answer.number
        frame = f"frame {answer.header.sequence}"
        ended = " · the stream is over" if self._state.ended else ""
        self._moment.text = f"{frame} · paused, {newer} newer" if paused else f"{frame}{ended}"
