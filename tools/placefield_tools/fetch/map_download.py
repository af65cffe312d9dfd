"""Fetching a map from a host that serves it."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from placefield.bus.maps import MapKeys, OfferMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.errors import BusError, MapError, MessageError
from placefield.maps.map import Map
from placefield.maps.receiving import PartialMap, opened_if_there, receiving
from placefield.maps.transfer import Chunk, Offer, digest_of

_RETRY_S = 0.2

Progress = Callable[[int, int], None]
"""Called with how many chunks are there, and of how many."""


@dataclass(frozen=True)
class _MapServer:
    """A host that serves the map."""

    identity: str
    offer: Offer


class Fetch:
    """Fetches one map, and continues after an interruption of the link or of the server."""

    def __init__(self, bus: Bus, name: str, config: BusConfig, stop: threading.Event) -> None:
        """Prepare to fetch the map of this name; give up after ``connect_timeout_s`` of silence."""
        self._bus = bus
        self._name = name
        self._keys = MapKeys(name)
        self._patience_s = config.connect_timeout_s
        self._stop = stop
        self._last_came = time.monotonic()
        self._trouble = "no host that has it answers"

    def into(self, path: Path, progress: Progress) -> tuple[Map, bool]:
        """Fetch the map to a path; return it, opened, and whether it was there already.

        Raises:
            MapError: the path holds something else, hosts offer different maps of this name,
                another process fetches the map, the disk is full, or the server's map is damaged.
            BusError: nothing arrived for too long, or ``stop`` was set.
        """
        with receiving(path) as partial:
            while True:
                server = self._find_server()
                if (there := opened_if_there(path, server.offer)) is not None:
                    return there, True
                partial.begin(server.offer)
                if self._fetch_missing(server, partial, progress):
                    return partial.finish(), False

    def _fetch_missing(self, server: _MapServer, partial: PartialMap, progress: Progress) -> bool:
        """Fetch all missing chunks; False if the server does not send a chunk."""
        progress(partial.there, server.offer.chunks)
        for chunk in partial.missing():
            data = self._chunk(server, chunk)
            if data is None:
                self._stop.wait(_RETRY_S)
                return False
            partial.add(chunk, data)
            self._last_came = time.monotonic()
            progress(partial.there, server.offer.chunks)
            self._check_stopped()
        return True

    def _chunk(self, server: _MapServer, chunk: Chunk) -> bytes | None:
        key = self._keys.chunk(server.identity, server.offer.digest, chunk.file, chunk.number)
        self._trouble = "the host that has it does not answer"
        for data, digest in self._bus.ask(key, timeout_s=self._patience_s / 2):
            if len(data) == chunk.length and digest == digest_of(data).encode():
                return data
            self._trouble = "what comes is damaged"
        return None

    def _find_server(self) -> _MapServer:
        """Wait for a host that serves the map."""
        while True:
            servers = list(self._servers())
            if len({server.offer.digest for server in servers}) > 1:
                raise MapError(
                    f"{self._name}: hosts have different maps of this name; "
                    "serve the others under other names"
                )
            if servers:
                self._check_patience()
                return servers[0]
            self._stop.wait(_RETRY_S)
            self._check_patience()

    def _servers(self) -> Iterator[_MapServer]:
        for written, about in self._bus.ask(self._keys.manifest, timeout_s=self._patience_s / 4):
            try:
                message = OfferMessage.decode(about)
                offer = Offer(written, message.sizes)
                offer.check()
            except (MapError, MessageError) as error:
                self._trouble = f"what is offered is refused: {error}"
                continue
            yield _MapServer(message.server, offer)

    def _check_stopped(self) -> None:
        if self._stop.is_set():
            raise BusError(f"{self._name}: stopped; the same command goes on where this one ended")

    def _check_patience(self) -> None:
        self._check_stopped()
        if time.monotonic() - self._last_came > self._patience_s:
            raise BusError(
                f"{self._name}: nothing has come for {self._patience_s:g} s: {self._trouble}; "
                f"start 'placefield serve {self._name}.pfmap' where it is; then the same command "
                "goes on where this one ended"
            )
