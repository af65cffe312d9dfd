"""The banner of the live page: what the state of the run is, if it is not simply live."""

import json
from html import escape

from nicegui import ui
from nicegui.events import GenericEventArguments

from placefield_tools.dashboard.run_state import RunState, Step


class Banner:
    """A line above the first row; hidden while frames are matched and all is well."""

    def __init__(self) -> None:
        self._shown: tuple[Step, ...] = ()
        section = ui.element("section").classes("banner live").props('aria-label="State"')
        with section as self._banner:
            self._words = ui.label("").props("role=status data-shown=state")
            self._steps = ui.element("div").classes("steps")

    def show(self, state: RunState) -> None:
        """Show the state of the run."""
        self._banner.classes(replace=f"banner {state.name}")
        self._words.text = state.words
        if state.steps == self._shown:  # a click on a replaced button would be lost
            return
        self._shown = state.steps
        self._steps.clear()
        with self._steps:
            for step in state.steps:
                _show_step(step)


def _show_step(step: Step) -> None:
    with ui.element("div"):
        ui.label(step.words)
        words = (f"<span>{escape(word)}</span>" for word in step.command.split(" "))
        ui.html(" ".join(words), sanitize=False, tag="code")
        button = ui.button(icon="content_copy", color=None).props("flat dense data-shown=copy")
        button.props["aria-label"] = button.props["title"] = f"Copy: {step.command}"
        copy = f"Quasar.copyToClipboard({json.dumps(step.command)})"  # also without HTTPS
        button.on(
            "click", _say, js_handler=f"() => {copy}.then(() => emit(true), () => emit(false))"
        )


def _say(copied: GenericEventArguments) -> None:
    ui.notify("Copied" if copied.args else "The browser does not let this page copy")
