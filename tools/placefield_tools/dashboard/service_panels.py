"""The panels of the live page for the run's services, and for starting a replay."""

import math

from nicegui import ui

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
    "partial": "in part",
    "counts": "other counts",
}
_TILES = {
    "rate": "frames per second",
    "behind": "frames behind",
    "gaps": "missed so far",
    "partial": "answered in part so far",
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

_DRAW_EVERY_S = 0.5
_APART = ("gaps", "partial")  # counts that have a column of their own


class HealthPanel:
    """The status of each service, and of the whole run."""

    def __init__(self, site: Site) -> None:
        self._site = site
        with card("Services", "two-thirds services"):
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
            self._not_shown_label = ui.label("").classes("quiet").props("data-shown=not-shown")

    def show(self, status: RunStatus, state: RunState) -> None:
        """Show the current status of the services, and what is the matter with the run."""
        all_well = f"all services are running{slowest_in_words(status)}"
        self._verdict.text = state.words if state.is_fault else all_well
        self._verdict.classes(**({"add": "warning"} if state.is_fault else {"remove": "warning"}))
        for name, value in _whole(status).items():
            self._tiles[name].text = value
        rows = [_row(service) for service in status.services]
        if rows != self._table.rows:
            self._table.rows = rows
        self._not_shown_label.text = self._not_shown()

    def _not_shown(self) -> str:
        """Name the messages that this page could not show."""
        feed, state = self._site.feed, self._site.state
        counts = {"dropped": feed.dropped, **feed.counts, **state.counts}
        named = ", ".join(f"{count} {_WHY[name]}" for name, count in counts.items() if count)
        return f"messages not shown: {named}" if named else ""


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


class ReplayPanel:
    """Starts a replay, and shows a button that stops it while it runs."""

    def __init__(self, site: Site, stop: ui.button) -> None:
        """Show the button ``stop``, which is elsewhere on the page, while a replay runs."""
        self._replay, self._stop = site.replay, stop
        self._is_first = False
        with card("Replay", "third replay") as self._card, ui.element("div").classes("form"):
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
            self._status = ui.label("").classes("quiet").props("role=status data-shown=replay")
        self._source.on("keydown.enter", self._start_replay)
        stop.on_click(self._stop_replay)
        ui.timer(_DRAW_EVERY_S, self._draw)

    def show(self, *, is_first: bool) -> None:
        """Show the panel first, where no frame has come yet, or last."""
        if is_first != self._is_first:
            self._is_first = is_first
            self._card.move(target_index=1 if is_first else -1)
            self._card.classes(**({"add": "wide"} if is_first else {"remove": "wide"}))

    def _start_replay(self) -> None:
        if self._source.value:
            self._replay.start(
                self._source.value, self._rate.value, self._camera.value, loop=self._loop.value
            )
        self._draw()

    def _stop_replay(self) -> None:
        self._replay.stop()
        self._draw()

    def _draw(self) -> None:
        self._status.text = self._replay.status
        runs = self._replay.runs
        self._start.set_enabled(not runs)
        self._stop.set_visibility(runs)
