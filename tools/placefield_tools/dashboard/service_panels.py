"""The panel of the live page for the run's services."""

import math
from collections.abc import Mapping

from nicegui import ui

from placefield_tools.dashboard.count_words import MEANINGS, glossary
from placefield_tools.dashboard.run_state import RunState
from placefield_tools.dashboard.service_words import (
    frames_behind,
    slowest_in_words,
    state_in_words,
)
from placefield_tools.dashboard.site import Site, card
from placefield_tools.status.service_status import RunStatus, ServiceStatus, counts_in_words

_COLUMNS = {
    "service": "service",
    "state": "state",
    "identity": "identity",
    "frame": "last frame",
    "behind": "frames behind",
    "rate": "frames/s",
    "gaps": "missed",
    "partial": "incomplete",
    "counts": "other counts",
}
_TILES = {
    "rate": "frames per second",
    "behind": "frames behind",
    "gaps": "frames missed so far",
    "partial": "incomplete answers so far",
}
_ITEM = """
    <details class="service" :key="props.key">
        <summary>
            <span class="strong">{{ props.row.service }}</span>
            <span :class="props.row.state == 'silent' && 'warning'">{{ props.row.state }}</span>
        </summary>
        <dl>
            <div v-for="column in props.cols.slice(2)" :key="column.name">
                <dt>{{ column.label }}</dt><dd>{{ column.value || "–" }}</dd>
            </div>
        </dl>
    </details>
"""
"""A service on a narrow page: the first two columns, and the others on request."""

_WHY = {
    "dropped": "faster than this page reads",
    "malformed": "unreadable",
    "foreign": "of another map",
    "missed": "that did not come",
}
"""Why messages are not shown, by the name of their count."""

_APART = ("gaps", "partial")  # counts that have a column of their own


_WORDS = {
    "frames behind": "newer frames that wait for the service",
    "missed": MEANINGS["gaps"],
    "incomplete": MEANINGS["partial"],
}


class HealthPanel:
    """The status of each service, and of the whole run."""

    def __init__(self, site: Site) -> None:
        self._site = site
        with card("Services", ""):
            self._verdict = ui.label("").props("role=status data-shown=services")
            with ui.element("div").classes("tiles"):
                self._tiles = {name: _tile(words) for name, words in _TILES.items()}
            self._table = ui.table(
                rows=[],
                row_key="identity",
                columns=[
                    {"name": name, "field": name, "label": label, "align": "left"}
                    for name, label in _COLUMNS.items()
                ],
            ).props('dense flat wrap-cells :grid="Quasar.Screen.lt.md"')
            self._table.add_slot("item", _ITEM)
            with ui.element("details").classes("service glossary").props("data-shown=glossary"):
                ui.html("What these words mean", sanitize=False, tag="summary")
                self._glossary = ui.html("", sanitize=False, tag="dl")
            self._not_shown_label = ui.label("").classes("quiet").props("data-shown=not-shown")

    def show(self, status: RunStatus, state: RunState) -> None:
        """Show the current status of the services, and what is the matter with the run."""
        slowest = slowest_in_words(status)
        running = "all services are running" + (slowest and f"; the slowest is {slowest}")
        self._verdict.text = state.words if state.is_fault else running
        self._verdict.classes(**({"add": "warning"} if state.is_fault else {"remove": "warning"}))
        for name, value in _whole(status).items():
            self._tiles[name].text = value
        rows = [_row(service) for service in status.services]
        if rows != self._table.rows:
            self._table.rows = rows
        counted = {name for service in status.services for name in service.counts}
        self._glossary.content = _in_html({**_WORDS, **glossary(counted - {*_APART})})
        self._not_shown_label.text = self._not_shown()

    def _not_shown(self) -> str:
        """Name the messages that this page could not show."""
        feed, state = self._site.feed, self._site.state
        counts = {"dropped": feed.dropped, **feed.counts, **state.counts}
        named = ", ".join(f"{count} {_WHY[name]}" for name, count in counts.items() if count)
        return f"messages not shown: {named}" if named else ""


def _in_html(words: Mapping[str, str]) -> str:
    return "".join(
        f"<div><dt>{word}</dt><dd>{meaning}</dd></div>" for word, meaning in words.items()
    )


def _tile(words: str) -> ui.label:
    with ui.element("div"):
        ui.label(words).classes("quiet")
        return ui.label("–").classes("value").props(f'data-shown="whole {words}"')


def _whole(status: RunStatus) -> dict[str, str]:
    """Return the run's figures: the fuser's rate, the most frames behind, sums of the counts."""
    fusers = [service for service in status.services if service.service == "fuser"]
    rate = max((fuser.rate or 0.0 for fuser in fusers), default=math.nan)
    behind = max(map(frames_behind, status.services), default=None)
    return {
        "rate": "–" if math.isnan(rate) else f"{rate:.1f}",
        "behind": "–" if behind is None else str(behind),
        **{name: str(_sum(status, name)) for name in _APART},
    }


def _sum(status: RunStatus, name: str) -> int:
    """Add up a count; the parts of one worker report the same counts once."""
    of_process = {
        (service.service, service.identity.rpartition("-")[2]): service.counts.get(name, 0)
        for service in status.services
    }
    return sum(of_process.values())


def _row(service: ServiceStatus) -> dict[str, str]:
    others = {name: count for name, count in service.counts.items() if name not in _APART}
    return {
        "service": service.name,
        "state": state_in_words(service),
        "identity": service.identity,
        "frame": "" if service.sequence is None else str(service.sequence),
        "behind": "" if service.behind is None else str(service.behind),
        "rate": "" if service.rate is None else f"{service.rate:.1f}",
        **{name: str(service.counts.get(name, 0)) for name in _APART},
        "counts": counts_in_words(others),
    }
