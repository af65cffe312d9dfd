"""The replay that a page starts and stops: a button in the header, and a form below it."""

from nicegui import ui

from placefield_tools.dashboard.site import Site, card

_DRAW_EVERY_S = 0.5


class ReplayPanel:
    """Starts a replay, and stops it.

    The button opens and closes the form. While a replay runs, it stops the replay.
    """

    def __init__(self, site: Site, button: ui.button) -> None:
        """Add the closed form; the button is elsewhere on the page."""
        self._replay, self._state, self._button = site.replay, site.state, button
        self._was_idle = False
        self._stream: str | None = None  # whose answers are shown
        self._has_failed = self._replay.has_failed  # before this page was opened
        button.props("outline no-caps data-shown=replay-button").classes("replay-button")
        button.on_click(self._press)
        with ui.element("div") as self._form, card("Replay", "replay"):
            self._fill_form()
        self._form.set_visibility(False)
        self._draw()
        ui.timer(_DRAW_EVERY_S, self._draw)

    def _fill_form(self) -> None:
        with ui.element("div").classes("form"):
            self._source = ui.input("Source: a folder, a video, camera:0").props(
                "dense outlined data-shown=source"
            )
            self._rate = ui.number("Frames per second; blank: as fast as answered", min=0.01).props(
                "dense outlined clearable data-shown=rate"
            )
            self._camera = ui.input("Calibration of the camera, a file; blank: none").props(
                "dense outlined data-shown=camera"
            )
            with ui.element("div").classes("controls"):
                self._loop = ui.checkbox("repeat from the start")
                self._start = ui.button("Start", on_click=self._start_replay)
                self._start.props("unelevated no-caps data-shown=start")
        self._status = ui.label("").props("role=status data-shown=replay")
        self._source.on("keydown.enter", self._start_replay)

    def show(self, *, is_idle: bool) -> None:
        """Open the form when the run becomes idle, and close it when a stream begins."""
        answers = self._state.answers
        stream = answers[-1].header.stream if answers else None
        if is_idle and not self._was_idle:
            self._open(is_open=True)
        elif stream != self._stream:
            self._open(is_open=False)
        self._was_idle, self._stream = is_idle, stream

    def _open(self, *, is_open: bool) -> None:
        self._form.set_visibility(is_open)
        self._draw()

    def _press(self) -> None:
        if self._replay.runs:
            self._replay.stop()
            self._state.note_stop()
            self._draw()
        else:
            self._open(is_open=not self._form.visible)

    def _start_replay(self) -> None:
        if self._source.value:
            self._replay.start(
                self._source.value, self._rate.value, self._camera.value, loop=self._loop.value
            )
        self._draw()

    def _draw(self) -> None:
        runs, failed = self._replay.runs, self._replay.has_failed
        if failed and not self._has_failed:
            self._form.set_visibility(True)
        self._has_failed = failed
        self._status.text = self._replay.status
        self._status.classes(replace="warning" if failed else "quiet")
        self._start.set_enabled(not runs)
        self._button.text = "Stop the replay" if runs else "Replay"
        self._button.props["icon"] = "stop" if runs else "play_arrow"
        self._button.props["aria-expanded"] = str(self._form.visible and not runs).lower()
