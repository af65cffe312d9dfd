"""The map server: it sends maps to other hosts."""

import threading
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox
from placefield.bus.maps import MapKeys, OfferMessage, chunk_of
from placefield.config import Config
from placefield.errors import ConfigError, MapError, MessageError
from placefield.maps.transfer import OwnMap, digest_of
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics

SERVICE = "mapserver"

Answer = tuple[bytes, bytes]  # payload and attachment


def run_mapserver(paths: Sequence[Path], config: Config, stop: threading.Event) -> None:
    """Serve these maps until ``stop`` is set.

    Raises:
        MapError: there is no map at a path, or its manifest is damaged.
        ConfigError: two maps have one name.
    """
    maps = {own.name: own for own in map(OwnMap, paths)}
    if len(maps) < len(paths):
        raise ConfigError("two maps of one name; give each name once")
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        for name, own in maps.items():
            keys = MapKeys(name)
            answers = MapAnswers(own, process.identity, process.counts.values())
            bus.answer(keys.manifest, answers.offer)
            bus.answer(keys.chunks(process.identity), answers.chunk)
        process.declare_ready(process.identity)
        process.serve(Inbox(process.counts), lambda received: None, stop)


class MapAnswers:
    """Answers the queries for one map.

    Counts the ``offers`` and ``chunks`` that were sent, and the ``refused`` queries.
    """

    def __init__(self, own: OwnMap, identity: str, counts: Collection[Counter[str]]) -> None:
        self._own = own
        self._identity = identity
        self._counts = counts

    def offer(self, key: str, asked: bytes) -> list[Answer]:
        """Answer with the manifest.

        Raises:
            MessageError: the map cannot be offered now.
        """
        with self._counted("offers"):
            offer = self._own.offer()
            about = OfferMessage(server=self._identity, sizes=dict(offer.sizes))
            return [(offer.written, about.encode())]

    def chunk(self, key: str, asked: bytes) -> list[Answer]:
        """Answer with a chunk of a file and its digest.

        Raises:
            MessageError: the map has no such chunk.
        """
        with self._counted("chunks"):
            data = self._own.chunk(*chunk_of(key))
            return [(data, digest_of(data).encode())]

    @contextmanager
    def _counted(self, what: str) -> Iterator[None]:
        try:
            yield
        except (MapError, MessageError, OSError) as error:
            self._count("refused")
            raise MessageError(str(error)) from None
        self._count(what)

    def _count(self, what: str) -> None:
        for counts in self._counts:
            counts[what] += 1
