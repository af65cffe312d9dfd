"""The raw features that a featurizer gets from the describers of a run."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import takewhile
from typing import Any, NamedTuple

from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import service_and_identity
from placefield.bus.message import Header
from placefield.bus.messages import RawFeatureMessage
from placefield.bus.refusing import count_refused
from placefield.bus.session import Bus
from placefield.errors import MessageError, OtherMapError
from placefield.features.extract import Array
from placefield_services.background_query import NotYet
from placefield_services.live_describers import LiveDescribers, live_describers
from placefield_services.process import ServiceProcess

MOST = 4 * WINDOW
"""The most frames whose parts are left to describers at a time, or whose raw features are kept."""

_LIVE_FRAMES = 2
"""Live frames of a run that may wait for the featurizer itself; older ones are dropped."""

_LOOK_EVERY_S = 0.05  # whether an awaited describer has died


class _Unit(NamedTuple):
    """A part of a frame."""

    stream: str
    sequence: int
    part: int


class RawKind(NamedTuple):
    """The raw features that a featurizer accepts.

    Attributes:
        model: fingerprint of their model.
        dimensions: the dimension of each part; None: none are accepted.
    """

    model: str
    dimensions: tuple[int | None, ...]

    def check(self, message: RawFeatureMessage) -> None:
        """Refuse a raw feature of another kind.

        Raises:
            MessageError: it has another dimension, or the feature has no such part.
            OtherMapError: it is of another model.
        """
        if message.model != self.model:
            raise OtherMapError(
                f"raw feature of model {message.model!r:.70}, not {self.model}; "
                "give all services one map"
            )
        if message.part >= len(self.dimensions):
            raise MessageError(f"part {message.part} of a feature of {len(self.dimensions)} parts")
        dimension = self.dimensions[message.part]
        if message.raw is not None and len(message.raw) != dimension:
            raise MessageError(f"raw feature of dimension {len(message.raw)}, not {dimension}")


class RawFeatures:
    """Leaves parts of frames to the describers of a run, and keeps the raw features that come.

    It waits for a describer that lives and has sent a raw feature, until that one has been silent
    for a while; then no longer, until its next raw feature. A describer sends in the order of the
    frames and parts: when a part has come, no earlier part of the same describer is waited for.

    Counts as ``described_here`` the parts of frames that were left to a describer and remain for
    the featurizer. A raw feature that is refused counts as ``malformed`` or ``other_map``.
    """

    def __init__(
        self,
        describers: LiveDescribers,
        kind: RawKind,
        patience_s: float,
        counts: Counter[str],
    ) -> None:
        """Begin with no frame.

        Args:
            describers: of the run.
            kind: the raw features to accept.
            patience_s: how long a describer may be silent, seconds.
            counts: of the run.
        """
        self._describers = describers
        self._kind = kind
        self._most = MOST * len(kind.dimensions)
        self._patience_s = patience_s
        self._counts = counts
        self._left_to: dict[_Unit, str] = {}  # in the order of arrival
        self._come: dict[_Unit, Array | None] = {}  # None: it will not come
        self._heard: dict[str, float] = {}  # when each describer that is waited for last sent
        self._asked: tuple[_Unit, float] | None = None
        self._lock = threading.Lock()

    def _units(self, header: Header) -> list[_Unit]:
        parts = range(len(self._kind.dimensions))
        return [_Unit(header.stream, header.sequence, part) for part in parts]

    def leave(self, header: Header) -> None:
        """Leave each part of a frame that has arrived to the describer whose turn it is."""
        if header.end:
            return
        for unit in self._units(header):
            describer = self._describers.whose(unit.sequence, unit.part)
            if describer is None:
                continue
            with self._lock:
                self._left_to.pop(unit, None)  # a frame that comes again is the newest
                if unit not in self._come:
                    self._left_to[unit] = describer
                    self._limit(self._left_to)

    def is_awaited(self, header: Header) -> bool:
        """Return whether a part of a frame has not come, and is worth waiting for."""
        with self._lock:
            return any(map(self._is_awaited, self._units(header)))

    def _is_awaited(self, unit: _Unit) -> bool:
        describer = self._left_to.get(unit)
        return describer in self._heard and describer in self._describers.workers

    def receive(self, received: Received, release: Callable[[str], None]) -> None:
        """Keep a raw feature; call ``release`` with its run if an asked part waits no longer."""
        describer = service_and_identity(received.key)[1]
        try:
            message = RawFeatureMessage.decode(received.payload)
            self._kind.check(message)
        except MessageError as error:
            count_refused(self._counts, error)
            with self._lock:
                self._heard.pop(describer, None)
        else:
            unit = _Unit(received.header.stream, received.header.sequence, message.part)
            with self._lock:
                self._keep(unit, describer, message.raw)
        with self._lock:
            is_over = self._asked is not None and not self._is_awaited(self._asked[0])
        if is_over:
            release(received.run)

    def _keep(self, unit: _Unit, describer: str, raw: Array | None) -> None:
        alive = self._describers.workers
        self._heard = {one: at for one, at in self._heard.items() if one in alive}
        if describer in alive:
            self._heard[describer] = time.monotonic()
        if self._left_to.get(unit) == describer:
            for passed in takewhile(lambda other: other != unit, list(self._left_to)):
                if self._left_to[passed] == describer:
                    del self._left_to[passed]
                    self._come.setdefault(passed, None)
        self._left_to.pop(unit, None)
        if self._come.get(unit) is None:
            self._come[unit] = raw
        self._limit(self._come)

    def take(
        self, header: Header, describe: Callable[[Sequence[int]], Mapping[int, Array]]
    ) -> Mapping[int, Array]:
        """Return the parts of a frame that are described, by number, once; describe the others.

        Args:
            header: of the frame.
            describe: describes parts of the frame. It is called while other parts are awaited, for
                those that are not; if it fails, no part is awaited any longer.

        Raises:
            NotYet: a part is awaited.
        """
        try:
            return self._take(header)
        except NotYet:
            own = self._own_parts(header)
            try:
                raws = describe([unit.part for unit in own])
            except Exception:  # describing the whole frame fails likewise, and then it is counted
                return {}
            self._keep_own(own, raws)
            raise

    def _take(self, header: Header) -> Mapping[int, Array]:
        units, now = self._units(header), time.monotonic()
        with self._lock:
            for unit in filter(self._is_awaited, units):
                self._wait(unit, now)
            self._asked = None
            raws = {unit.part: self._pop(unit) for unit in units}
        return {part: raw for part, raw in raws.items() if raw is not None}

    def _wait(self, unit: _Unit, now: float) -> None:
        """Wait for an awaited part, or give up its describer, which has been silent for too long.

        Raises:
            NotYet: wait.
        """
        describer = self._left_to[unit]
        if self._asked is None or self._asked[0] != unit:
            self._asked = unit, now
        end = max(self._asked[1], self._heard[describer]) + self._patience_s
        if now < end:
            raise NotYet(min(end - now, _LOOK_EVERY_S))
        del self._heard[describer]

    def _pop(self, unit: _Unit) -> Array | None:
        """Return a part if it has come; it is left to no describer any longer."""
        was_left = unit in self._left_to or unit in self._come
        self._left_to.pop(unit, None)
        raw = self._come.pop(unit, None)
        if raw is None and was_left:
            self._counts["described_here"] += 1
        return raw

    def _own_parts(self, header: Header) -> list[_Unit]:
        """Return the parts of a frame that have not come and are not awaited."""
        with self._lock:
            units = [unit for unit in self._units(header) if not self._is_awaited(unit)]
            return [unit for unit in units if self._come.get(unit) is None]

    def _keep_own(self, units: Sequence[_Unit], raws: Mapping[int, Array]) -> None:
        with self._lock:
            for unit in units:
                self._pop(unit)
                self._come[unit] = raws[unit.part]
            self._limit(self._come)

    def _limit(self, units: dict[_Unit, Any]) -> None:
        while len(units) > self._most:
            del units[next(iter(units))]


def receive_frames(
    bus: Bus, process: ServiceProcess, kind: RawKind, patience_s: float
) -> tuple[Inbox, Mapping[str, RawFeatures]]:
    """Receive the frames of a featurizer, and their raw features from the describers of each run.

    Returns:
        The inbox of the frames, and the raw features of each run.
    """
    raws = {
        run: RawFeatures(live_describers(bus, keys), kind, patience_s, process.counts[run])
        for run, keys in process.keys.items()
    }
    inbox = Inbox(
        process.counts,
        live_capacity=_LIVE_FRAMES,
        keeps=lambda received: raws[received.run].is_awaited(received.header),
    )

    def offer(received: Received) -> None:
        raws[received.run].leave(received.header)
        inbox.offer(received)

    for run, keys in process.keys.items():
        receive = partial(raws[run].receive, release=inbox.release)
        bus.subscribe(keys.all_raws, receive, process.counts[run])
        bus.subscribe(keys.frame, offer, process.counts[run])
    return inbox, raws
