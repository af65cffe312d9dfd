"""The live frames that a featurizer has described, and that are not answered yet.

If there are more cameras than the services can follow, a featurizer that describes all frames takes
the processors from the services behind it, whose answers then come too late. So a live frame waits
until an earlier one of its run is answered. While it waits, a newer one may displace it: frames are
dropped before they cost any work, and each run gets the same share.
"""

import threading
import time
from collections.abc import Callable, Mapping
from functools import partial

from placefield.bus.inbox import Inbox, Received
from placefield.bus.message import Header
from placefield.bus.session import Bus
from placefield_services.background_query import NotYet
from placefield_services.process import ServiceProcess

_TOGETHER = 8  # frames of all runs of a featurizer, if each has one


class FramesUnderWay:
    """Counts the frames under way of a run's live stream; the bus and the service may both call."""

    def __init__(self, runs: int, patience_s: float, release: Callable[[], None]) -> None:
        """Begin without a frame.

        Args:
            runs: of the featurizer.
            patience_s: after so long, a frame counts as answered: its answer was lost.
            release: called when a frame was answered, after which ``check`` may pass.
        """
        self._most = max(1, _TOGETHER // runs)
        self._patience_s, self._release = patience_s, release
        self._stream = ""
        self._since: dict[int, float] = {}
        self._lock = threading.Lock()

    def check(self, header: Header) -> None:
        """Let a frame pass if it may be described now.

        Raises:
            NotYet: too many live frames before it are not answered.
        """
        if not header.live or header.end:
            return
        with self._lock:
            now = time.monotonic()
            due = now - self._patience_s
            self._since = {frame: since for frame, since in self._since.items() if since > due}
            if header.stream == self._stream and len(self._since) >= self._most:
                raise NotYet(min(self._since.values()) - due)

    def add(self, header: Header) -> None:
        """Count a frame that will be described: its answer may come as soon as it is."""
        if not header.live or header.end:
            return
        with self._lock:
            if header.stream != self._stream:
                self._stream, self._since = header.stream, {}
            self._since[header.sequence] = time.monotonic()

    def discard(self, header: Header) -> None:
        """Do not count a frame any more: it was not described."""
        with self._lock:
            if header.stream == self._stream:
                self._since.pop(header.sequence, None)

    def receive(self, received: Received) -> None:
        """Receive the answer of a frame, which stands for those of all frames before it."""
        header = received.header
        with self._lock:
            if header.stream != self._stream:
                return
            self._since = {
                frame: since for frame, since in self._since.items() if frame > header.sequence
            }
        self._release()


def follow_answers(
    bus: Bus, process: ServiceProcess, inbox: Inbox, patience_s: float
) -> Mapping[str, FramesUnderWay]:
    """Follow which live frames of each run of a featurizer are answered."""
    under_way = {}
    for run, keys in process.keys.items():
        of_run = FramesUnderWay(len(process.keys), patience_s, partial(inbox.release, run))
        bus.subscribe(keys.ack, of_run.receive, process.counts[run])
        under_way[run] = of_run
    return under_way
