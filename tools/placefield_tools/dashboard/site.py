"""What all pages of the dashboard show, and the parts that they are made of."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from nicegui import ui

from placefield.maps.map import Map
from placefield_tools.dashboard.charts import Options
from placefield_tools.dashboard.commands import Commands
from placefield_tools.dashboard.feed import Feed
from placefield_tools.dashboard.replay_process import ReplayChild
from placefield_tools.dashboard.state import LiveState


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
def card(title: str, span: str) -> Iterator[ui.html]:
    """Add a titled part of a page; the span is its width: ``third``, ``half``, ….

    The block is given the heading.
    """
    with ui.element("section").classes(f"card {span}").props(f'aria-label="{title}"'):
        yield ui.html(title, sanitize=False, tag="h2")


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
