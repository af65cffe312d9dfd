"""The banner of the live page: what the state of the run is, if it is not simply live."""

from nicegui import ui

from placefield_tools.dashboard.run_state import RunState
from placefield_tools.dashboard.site import Site


class Banner:
    """A line above the first row; hidden while frames are matched and all is well."""

    def __init__(self, site: Site) -> None:
        self._site = site
        with (
            ui.element("section").classes("banner live").props('aria-label="State"') as self._banner
        ):
            self._words = ui.label("").props("role=status data-shown=state")
            self._command = ui.html(site.commands.replay, sanitize=True, tag="code")

    def show(self, state: RunState) -> None:
        """Show the state of the run."""
        self._banner.classes(replace=f"banner {state.name}")
        self._words.text = state.words
        self._command.set_visibility(state.name == "idle")
