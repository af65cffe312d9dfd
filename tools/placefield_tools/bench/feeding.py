"""Publishes descriptors in place of the featurizer."""

import threading
import time
import uuid
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.bus.credits import Credits
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, MatchMessage
from placefield.bus.session import Bus
from placefield.errors import BusError
from placefield.fusion.match import Match

_LONGEST_S = 120.0  # that a match may take


class Feeder:
    """Publishes descriptors as a lossless stream and collects its matches."""

    def __init__(self, bus: Bus, run: str, model: str) -> None:
        """Keep the run, and the fingerprint of the descriptors' model."""
        keys = Keys(run)
        self._model = model
        self._publisher = bus.publisher(keys.feature)
        self._begin()
        bus.subscribe(keys.match, self._answer, Counter())

    def _begin(self) -> None:
        self._stream = uuid.uuid4().hex
        self._credits = Credits()
        self._matches: dict[int, Match] = {}
        self._ended = threading.Event()

    def _answer(self, received: Received) -> None:
        header = received.header
        if header.stream != self._stream:
            return
        if header.end:
            self._ended.set()
        else:
            self._matches[header.sequence] = MatchMessage.decode(received.payload).match
            self._credits.answer(header.sequence)

    def feed(self, descriptors: Sequence[NDArray[np.float32]]) -> tuple[list[Match], float]:
        """Publish descriptors (N,); return their matches in order, and the seconds that took.

        Raises:
            BusError: the services do not answer.
        """
        start = time.perf_counter()
        for sequence, descriptor in enumerate(descriptors):
            if not self._credits.acquire(_LONGEST_S):
                raise BusError(f"no match for {_LONGEST_S:g} s")
            message = FeatureMessage(model=self._model, descriptor=descriptor)
            self._publisher.put(self._header(sequence), message)
        self._publisher.put(self._header(len(descriptors), end=True))
        if not self._ended.wait(_LONGEST_S):
            raise BusError(f"the stream did not end within {_LONGEST_S:g} s")
        seconds = time.perf_counter() - start
        matches = [self._matches[sequence] for sequence in range(len(descriptors))]
        self._begin()
        return matches, seconds

    def _header(self, sequence: int, *, end: bool = False) -> Header:
        return Header(stream=self._stream, sequence=sequence, stamp_ns=0, end=end)
