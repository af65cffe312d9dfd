"""Publishes the status of a run's services as ROS 2 diagnostics."""

import time

from placefield.bus.keys import service_and_identity
from placefield.bus.messages import StatsMessage
from placefield.bus.ros_node import RosPublisher
from placefield.ros.ros_messages import OK, STALE, WARN, Status, diagnostics_message

_PUBLISH_EVERY_S = 1.0
_SILENT_S = 3.0  # a service reports once a second
_FORGOTTEN_S = 60.0  # a restarted service has another identity
_TROUBLE = (
    "malformed",
    "other_map",
    "failed",
    "unreadable",
    "blank",
    "unknown_channel",
    "dropped_full",
    "dropped_old",
    "forgotten",
    "gaps",
    "late",
    "partial",
)


Process = tuple[str, str]
"""A service and an identity."""


class Diagnostics:
    """Publishes once a second a status for each process of a run's services.

    The status is ``STALE`` if the process has been silent for 3 s; after a minute it is left out.
    The status is ``WARN`` if frames or messages were lost or damaged since the last one; else it is
    ``OK``. Its values are all counts since the process started.
    """

    def __init__(self, run: str, publisher: RosPublisher) -> None:
        self._run = run
        self._publisher = publisher
        self._received: dict[Process, tuple[StatsMessage, float]] = {}
        self._published: dict[Process, dict[str, int]] = {}  # counts
        self._due = 0.0

    def receive(self, key: str, data: bytes) -> None:
        """Receive the statistics of a process.

        Raises:
            MessageError: the message does not parse.
        """
        stats = StatsMessage.decode(data)
        self._received[service_and_identity(key)] = stats, time.monotonic()

    def publish(self) -> None:
        """Publish all statuses, if a second has passed."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + _PUBLISH_EVERY_S
        self._received = {
            process: received
            for process, received in self._received.items()
            if now - received[1] < _FORGOTTEN_S
        }
        statuses = [
            self._status(process, stats, now - at > _SILENT_S)
            for process, (stats, at) in sorted(self._received.items(), key=lambda item: item[0])
        ]
        self._published = {process: stats.counts for process, (stats, _) in self._received.items()}
        self._publisher.put(diagnostics_message(time.time_ns(), statuses))

    def _status(self, process: Process, stats: StatsMessage, is_silent: bool) -> Status:
        level, message = OK, "ok"
        if trouble := self._trouble(process, stats):
            level, message = WARN, trouble
        if is_silent:
            level, message = STALE, f"silent for {_SILENT_S:g} s"
        values = {name: str(count) for name, count in sorted(stats.counts.items())}
        if stats.sequence is not None:
            values["newest_frame"] = str(stats.sequence)
        return Status(level, f"placefield: {' '.join(process)}", message, self._run, values)

    def _trouble(self, process: Process, stats: StatsMessage) -> str:
        """Describe what went wrong since the last status; empty if nothing did."""
        before = self._published.get(process, stats.counts)
        more = {name: stats.counts.get(name, 0) - before.get(name, 0) for name in _TROUBLE}
        return ", ".join(f"{count} {name}" for name, count in more.items() if count > 0)
