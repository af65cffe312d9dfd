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
from placefield_tools.dashboard.page import Page, page
from placefield_tools.dashboard.panels import CertaintyPanel, LostPanel, MatrixPanel
from placefield_tools.dashboard.run_state import run_state
from placefield_tools.dashboard.service_panels import HealthPanel
from placefield_tools.dashboard.site import Site

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
    with page(site, "Live") as parts:
        LivePage(site, parts)


class AnswerPanel(Protocol):
    """A panel that shows a part of an answer."""

    def show(self, answer: Answer) -> None:
        """Show an answer."""


class LivePage:
    """One browser's view of the run: it follows, or is paused at an answer."""

    def __init__(self, site: Site, parts: Page) -> None:
        """Fill the page's main part."""
        self._site, self._state = site, site.state
        self._board, self._replay = parts
        self._placemap = site.placemap
        self._is_current = True
        self._paused_at: Answer | None = None
        self._shown: tuple[Answer, object] | None = None
        self._banner = Banner()
        with ui.element("div").classes("first"):
            self._verdict = VerdictPanel(site)
            first = (
                self._verdict,
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
        self._draw_status()
        ui.timer(_DRAW_EVERY_S, self._draw_in_turn)
        ui.timer(_STATUS_EVERY_S, self._draw_status)

    def _lay_out_controls(self) -> None:
        section = ui.element("section").classes("card").props('aria-label="Time"')
        with section, ui.element("div").classes("controls"):
            self._pause = ui.button("Pause", on_click=self._pause_or_follow, color=None)
            self._pause.classes("pause").props("unelevated no-caps data-shown=pause")
            self._pause.props('title="Space"').disable()
            ui.button(icon="chevron_left", on_click=lambda: self._step(-1)).props(
                'flat round aria-label="One frame back" title="Left arrow; with shift: ten frames"'
            )
            ui.button(icon="chevron_right", on_click=lambda: self._step(1)).props(
                'flat round aria-label="One frame on" title="Right arrow; with shift: ten frames"'
            )
            self._slider = ui.slider(min=0, max=1, value=1).props(
                'aria-label="Look back over the last answers" data-shown=slider'
            )
            self._slider.disable()
            self._slider.on("update:model-value", self._look_back, throttle=0.05)
            self._moment = ui.label("no answer yet").classes("moment")
            self._moment.props("data-shown=moment")
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
        """Pause, or follow again; a stream that is over cannot be paused."""
        if self._shown and self._paused_at is None and not self._state.ending:
            self._paused_at = self._shown[0]
        else:
            self._paused_at = None
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
        """Show the state of the run and its services.

        The page is ``over`` after the end of a stream, and ``stale`` while no match can come.
        """
        status = self._site.feed.status()
        state = run_state(
            self._state,
            status,
            connected=self._site.feed.connected,
            commands=self._site.commands,
        )
        self._health.show(status, state)
        self._banner.show(state)
        self._verdict.show_services(status, state)
        self._replay.show(is_idle=state.name == "idle")
        over = " over" if self._state.ending else ""
        self._is_current = state.is_current
        stale = "" if state.is_current else " stale"
        self._board.classes(replace=f"board{over}{stale}")

    def _draw_controls(self, answer: Answer) -> None:
        answers, paused = self._state.answers, self._paused_at is not None
        for end, number in (("min", answers[0].number), ("max", answers[-1].number)):
            if self._slider.props[end] != number:  # setting it sends it, whatever it was
                self._slider.props[end] = number
        self._slider.value = max(answer.number, answers[0].number)
        self._slider.enable()
        ending = self._state.ending
        self._pause.text = "Last frame" if ending else "Back to live" if paused else "Pause"
        self._pause.set_enabled(paused or (self._is_current and not ending))
        self._moment.text = self._moment_of(answer)
        self._verdict.show_time(answer, is_newest=not paused, is_current=self._is_current)

    def _moment_of(self, answer: Answer) -> str:
        """Say which frame is shown, and how it lies to the newest one."""
        frame, ending = f"frame {answer.header.sequence}", self._state.ending
        if self._paused_at is None:
            return f"{frame} · {ending}" if ending else frame
        newer = self._state.answers[-1].number - answer.number
        return (
            f"{frame} · {newer} before the last" if ending else f"{frame} · paused, {newer} newer"
        )
