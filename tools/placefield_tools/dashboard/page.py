"""The header, the replay and the style that all pages of the dashboard share."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

from nicegui import app, ui

from placefield.maps.map import Map
from placefield_tools.dashboard.replay_panel import ReplayPanel
from placefield_tools.dashboard.site import Site

_STYLE = Path(__file__).with_name("style.css").read_text()
_LOOK_EVERY_S = 0.5
_PAGES = {"Live": "/", "Map": "/map"}
_COLOURS: dict[bool | None, tuple[str, str, bool | None]] = {
    None: ("brightness_auto", "Colours as the system has them: change to dark", True),
    True: ("dark_mode", "Dark colours: change to light", False),
    False: ("light_mode", "Light colours: change to those of the system", None),
}
"""For each setting: the icon, the words of the button, and the next setting."""


class Page(NamedTuple):
    """A page: its main part, and the replay that it may start."""

    board: ui.element
    replay: ReplayPanel


@contextmanager
def page(site: Site, current: str) -> Iterator[Page]:
    """Lay out a page: a header, and a main part for the block to fill.

    A page is of one version of the map, and is loaded again when another one is shown.
    """
    ui.timer(_LOOK_EVERY_S, partial(_reload_if_replaced, site, site.placemap))
    ui.add_css(_STYLE)
    with ui.header(fixed=False).classes("top"):
        ui.html("Placefield", sanitize=False, tag="h1")
        ui.label(f"run {site.commands.run} · map {site.commands.map_path.stem}").classes("quiet")
        replay = ui.button()
        with ui.element("nav").props('aria-label="Pages"'):
            for name, path in _PAGES.items():
                link = ui.link(name, path)
                if name == current:
                    link.props("aria-current=page")
        _colour_button()
    board = ui.element("div").classes("board")
    ui.skip_link(target=board)
    with board:
        yield Page(board, ReplayPanel(site, replay))


def _reload_if_replaced(site: Site, shown: Map) -> None:
    if site.placemap is not shown:
        ui.navigate.reload()


def _colour_button() -> None:
    """Add a button for the colours: the system's, dark or light. The page keeps the choice."""
    dark = ui.dark_mode(None)
    button = ui.button(icon=_COLOURS[None][0]).props("flat round dense data-shown=colours")

    def show() -> None:
        icon, words, _ = _COLOURS[dark.value]
        button.props["icon"], button.props["aria-label"] = icon, words
        button.props["title"] = words

    def change() -> None:
        dark.value = app.storage.tab["dark"] = _COLOURS[dark.value][2]
        show()

    def fetch() -> None:
        dark.value = app.storage.tab.get("dark")
        show()

    button.on_click(change)
    show()
    ui.timer(0, fetch, once=True)
