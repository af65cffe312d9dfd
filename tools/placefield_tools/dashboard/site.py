"""The frame and the style that all pages of the dashboard share."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from nicegui import app, ui

from placefield.maps.map import Map
from placefield_tools.dashboard.charts import Options
from placefield_tools.dashboard.commands import Commands
from placefield_tools.dashboard.feed import Feed
from placefield_tools.dashboard.replay_process import ReplayChild
from placefield_tools.dashboard.state import LiveState

_STYLE = Path(__file__).with_name("style.css").read_text()
_LOOK_EVERY_S = 0.5
_PAGES = {"Live": "/", "Map": "/map"}
_COLOURS: dict[bool | None, tuple[str, str, bool | None]] = {
    None: ("brightness_auto", "Colours as the system has them: change to dark", True),
    True: ("dark_mode", "Dark colours: change to light", False),
    False: ("light_mode", "Light colours: change to those of the system", None),
}
"""For each setting: the icon, the words of the button, and the next setting."""


@dataclass(frozen=True)
class Site:
    """A run, its map, and the replay that the page may start.

    Attributes:
        commands: for the run and its map.
        state: the newest answers of the run, and the version of the map that they are of.
        feed: the run's messages, which update the state.
        replay: the replay that the page starts and stops.
        precision: the probability from which on a match is known.
    """

    commands: Commands
    state: LiveState
    feed: Feed
    replay: ReplayChild
    precision: float

    @property
    def placemap(self) -> Map:
        """The shown version of the map."""
        return self.state.placemap


@contextmanager
def page(site: Site, current: str) -> Iterator[ui.element]:
    """Lay out a page: a header, and a main part for the block to fill.

    A page is of one version of the map, and is loaded again when another one is shown.
    """
    ui.timer(_LOOK_EVERY_S, partial(_reload_if_replaced, site, site.placemap))
    ui.add_css(_STYLE)
    with ui.header(fixed=False).classes("top"):
        ui.html("Placefield", sanitize=False, tag="h1")
        ui.label(f"run {site.commands.run} · map {site.commands.map_path.stem}").classes("quiet")
        with ui.element("nav").props('aria-label="Pages"'):
            for name, path in _PAGES.items():
                link = ui.link(name, path)
                if name == current:
                    link.props("aria-current=page")
        _colour_button()
    board = ui.element("div").classes("board")
    ui.skip_link(target=board)
    with board:
        yield board


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


@contextmanager
def card(title: str, span: str) -> Iterator[ui.element]:
    """Add a titled part of a page; the span is its width: ``third``, ``half``, …."""
    with ui.element("section").classes(f"card {span}").props(f'aria-label="{title}"') as section:
        ui.html(title, sanitize=False, tag="h2")
        yield section


def chart(options: Options, words: str) -> ui.echart:
    """Add a chart, with words for screen readers."""
    return ui.echart(options).classes("chart").props(f'role=img aria-label="{words}"')


def svg(inside: str, width: float, height: float, words: str, *, stretch: bool = False) -> str:
    """Return a drawing as an SVG element, with words for screen readers; no words hide it."""
    said = f'role="img" aria-label="{words}"' if words else 'aria-hidden="true"'
    aspect = "none" if stretch else "xMidYMid meet"
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" preserveAspectRatio="{aspect}" {said}>'
        f"{inside}</svg>"
    )
