"""The live page: the newest answer, or an earlier one to look at."""

from contextlib import suppress

from nicegui import ui
from nicegui.events import GenericEventArguments, KeyEventArguments

from placefield_tools.dashboard.field_panel import FieldsPanel
from placefield_tools.dashboard.missing_services import can_answer, missing_in_words
from placefield_tools.dashboard.panels import (
    AnswerPanel,
    CertaintyPanel,
    FramesPanel,
    MatchPanel,
    MatrixPanel,
    RoutePanel,
)
from placefield_tools.dashboard.service_panels import HealthPanel, ReplayPanel
from placefield_tools.dashboard.site import Site, page
from placefield_tools.dashboard.state import Answer

_DRAW_EVERY_S = 0.1
_STATUS_EVERY_S = 1.0  # services report as often
_WHEN_DRAWN = "return new Promise(drawn => requestAnimationFrame(() => drawn(true)))"
_PATIENCE_S = 10.0


def live_page(site: Site) -> None:
    """Lay out the page for one viewer."""
    with page(site, "Live") as board:
        LivePage(site, board)


class LivePage:
    """One browser's view of the run: it follows, or is paused at an answer."""

    def __init__(self, site: Site, board: ui.element) -> None:
        """Fill the page's main part; it is ``stale`` while no match can come."""
        self._state, self._feed, self._board = site.state, site.feed, board
        self._placemap = site.placemap
        self._paused_at: Answer | None = None
        self._shown: Answer | None = None
        self._lay_out_controls()
        frames, self._match = FramesPanel(site), MatchPanel(site)
        self._panels: list[AnswerPanel] = [
            frames,
            self._match,
            FieldsPanel(site),
            MatrixPanel(site),
            CertaintyPanel(site),
            RoutePanel(site),
        ]
        self._health = HealthPanel(site)
        ReplayPanel(site)
        ui.timer(_DRAW_EVERY_S, self._draw_in_turn)
        ui.timer(_STATUS_EVERY_S, self._draw_status)

    def _lay_out_controls(self) -> None:
        section = ui.element("section").classes("card").props('aria-label="Time"')
        with section, ui.element("div").classes("controls"):
            self._pause = ui.button("Pause", on_click=self._pause_or_follow)
            self._pause.props("dense unelevated no-caps data-shown=pause")
            ui.button(icon="chevron_left", on_click=lambda: self._step(-1)).props(
                'flat round dense aria-label="One frame back"'
            )
            ui.button(icon="chevron_right", on_click=lambda: self._step(1)).props(
                'flat round dense aria-label="One frame on"'
            )
            self._slider = ui.slider(min=0, max=1, value=1).props(
                'aria-label="Look back over the last answers" data-shown=slider'
            )
            self._slider.on("update:model-value", self._look_back, throttle=0.05)
            self._moment = ui.label("no answer yet").classes("moment")
            self._moment.props("data-shown=moment")
        ui.keyboard(self._press)

    def _press(self, pressed: KeyEventArguments) -> None:
        if not pressed.action.keydown:
            return
        if pressed.key.space:
            self._pause_or_follow()
        elif pressed.key.arrow_left:
            self._step(-1)
        elif pressed.key.arrow_right:
            self._step(1)

    def _pause_or_follow(self) -> None:
        self._paused_at = self._shown if self._paused_at is None else None
        self._draw()

    def _look_back(self, moved: GenericEventArguments) -> None:
        self._pause_at(int(moved.args))

    def _step(self, by: int) -> None:
        if self._shown is not None:
            self._pause_at(self._shown.number + by)

    def _pause_at(self, number: int) -> None:
        self._paused_at = self._state.at(number) or self._paused_at
        self._draw()

    async def _draw_in_turn(self) -> None:
        """Draw, and wait for the browser: a slow or hidden browser is sent fewer updates."""
        self._draw()
        with suppress(TimeoutError):
            await ui.run_javascript(_WHEN_DRAWN, timeout=_PATIENCE_S)

    def _draw(self) -> None:
        """Draw the changes."""
        answers = self._state.answers
        if not answers or self._state.placemap is not self._placemap:  # the page is loaded again
            return
        answer = self._paused_at or answers[-1]
        if answer is not self._shown:
            self._shown = answer
            for panel in self._panels:
                panel.show(answer)
        if self._state.smoothed is not None:
            self._match.show_smoothed(*self._state.smoothed)
        self._draw_controls(answer)

    def _draw_status(self) -> None:
        """Show the status of the services, and grey the match when no newer one can come."""
        status = self._feed.status()
        self._health.show(status)
        stale = bool(self._state.answers) and not can_answer(status)
        self._board.classes(**({"add": "stale"} if stale else {"remove": "stale"}))
        self._match.warn(("not current; " if stale else "") + missing_in_words(status))

    def _draw_controls(self, answer: Answer) -> None:
        answers, paused = self._state.answers, self._paused_at is not None
        self._slider.props["min"], self._slider.props["max"] = answers[0].number, answers[-1].number
        self._slider.value = max(answer.number, answers[0].number)
        self._pause.text = "Follow" if paused else "Pause"
        newer = answers[-1].number - answer.number
        frame = f"frame {answer.header.sequence}"
        ended = " · the stream is over" if self._state.ended else ""
        self._moment.text = f"{frame} · paused, {newer} newer" if paused else f"{frame}{ended}"
