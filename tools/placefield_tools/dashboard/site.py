"""What all pages of the dashboard show, and what they share in looks."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from nicegui import app, ui

from placefield.maps.map import Map
from placefield_tools.dashboard.charts import Options
from placefield_tools.dashboard.feed import Feed
from placefield_tools.dashboard.replay_process import ReplayChild
from placefield_tools.dashboard.state import LiveState

_STYLE = Path(__file__).with_name("style.css").read_text()
_PAGES = {"Live": "/", "Map": "/map"}
_COLOURS: dict[bool | None, tuple[str, str, bool | None]] = {
    None: ("brightness_auto", "Colours as the system has them: change to dark", True),
    True: ("dark_mode", "Dark colours: change to light", False),
    False: ("light_mode", "Light colours: change to those of the system", None),
}
"""By what is on: the icon, what the button says, and what comes next."""


@dataclass(frozen=True)
class Site:
    """What is shown: a run, its map, and a replay that may be started.

    Attributes:
        run: its name.
        map_name: of its map.
        placemap: the map.
        state: of the run.
        feed: what it comes from.
        replay: what the page starts.
    """

    run: str
    map_name: str
    placemap: Map
    state: LiveState
    feed: Feed
    replay: ReplayChild


@contextmanager
def page(site: Site, current: str) -> Iterator[ui.element]:
    """Lay out a page: a header, and a main part, which the block is given and fills."""
    ui.add_css(_STYLE)
    with ui.header(fixed=False).classes("top"):
        ui.html("Placefield", sanitize=False, tag="h1")
        ui.label(f"run {site.run} · map {site.map_name}").classes("quiet")
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


def _colour_button() -> None:
    """Put a button that goes from the system's colours to dark to light; the page remembers."""
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
def card(title: str, span: str) -> Iterator[None]:
    """Put a titled part of a page, that takes a share of its width: ``third``, ``half``, …."""
    with ui.element("section").classes(f"card {span}").props(f'aria-label="{title}"'):
        ui.html(title, sanitize=False, tag="h2")
        yield


def chart(options: Options, words: str) -> ui.echart:
    """Put a chart that says in words what it shows."""
    return ui.echart(options).classes("chart").props(f'role=img aria-label="{words}"')


def svg(inside: str, width: float, height: float, words: str, *, stretch: bool = False) -> str:
    """Return a drawing as an SVG element that says in words what it shows; none: it is hidden."""
    said = f'role="img" aria-label="{words}"' if words else 'aria-hidden="true"'
    aspect = "none" if stretch else "xMidYMid meet"
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" preserveAspectRatio="{aspect}" {said}>'
        f"{inside}</svg>"
    )
