"""The fuser: candidates in, one match per frame out."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox
from placefield.bus.keys import Keys
from placefield.bus.replay_cache import (
    CachedPublisher,
    ReplayCache,
    fetch_all,
    replicated_cache,
    serve_cache,
)
from placefield.bus.session import Bus
from placefield.config import Config
from placefield.fusion.fusion_stage import FusionStage
from placefield.maps.map import Map
from placefield.maps.route_graph import check_rule
from placefield_services.fuser_run import FuserCaches, FuserRun
from placefield_services.fusion_parts import RunParts
from placefield_services.live_channels import LiveChannels
from placefield_services.map_versions import MapVersions, PreparedVersions
from placefield_services.match_publisher import FuserOutputs
from placefield_services.moments import cache_moments
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.served import FuserVersion

SERVICE = "fuser"

NewVersion = tuple[FuserVersion, Callable[[], bool]]
"""A new version of the map, and whether it is still there, see ``FuserRun.offer``."""


def run_fuser(versions: MapVersions, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set; ready when all channels are, or the bus's time-out is over.

    Raises:
        MapError: the map cannot be opened.
        ConfigError: the rule does not follow the map's descriptors, or its routes.
    """

    def prepare(placemap: Map) -> FuserVersion:
        placemap.features.check_rule(config.matching.rule)
        check_rule(config.matching.rule, len(placemap.graph.names))
        stage = FusionStage(placemap.topology, config.matching, placemap.places.pose)
        stage.warm_up()
        return FuserVersion(placemap, stage)

    first = prepare(versions.open())
    prepared = PreparedVersions(versions, prepare)
    serve_fuser(first, config, stop, partial(_new_versions, versions, prepared))


def _new_versions(
    versions: MapVersions, prepared: PreparedVersions[FuserVersion]
) -> Iterator[NewVersion]:
    for version in prepared.pop_all():
        yield version, partial(versions.is_there, version.served.digest)


def serve_fuser(
    first: FuserVersion,
    config: Config,
    stop: threading.Event,
    new_versions: Callable[[], Iterable[NewVersion]] = tuple,
) -> None:
    """Serve until ``stop`` is set; see ``run_fuser``.

    Args:
        first: the version of the map that answers at first.
        config: of the fuser.
        stop: ends the fuser.
        new_versions: returns the versions that are new since the last call, see ``FuserRun.offer``.
    """
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        process.channels = len(first.served.channels)
        inbox = Inbox(process.counts)
        fusers = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            bus.subscribe(keys.all_candidates, inbox.offer, process.counts[run], ends_empty=False)
            channels = LiveChannels(process.channels)
            bus.watch_alive(keys.all_alive("channel"), channels.change)
            features = replicated_cache(bus, keys.cache(keys.feature))
            moments = cache_moments(bus, keys, process.counts[run])
            outputs = FuserOutputs(
                _shared(bus, keys, keys.match),
                _shared(bus, keys, keys.smoothed),
                bus.publisher(keys.ack),
            )
            process.answers[run] = outputs.matches.cache
            candidates = partial(fetch_all, bus, keys.cache(keys.all_candidates))
            parts = RunParts(config, channels, outputs, process.counts[run])
            caches = FuserCaches(features, moments, candidates)
            fusers[run] = FuserRun(first, keys, parts, caches)
        del first  # so that it is freed when a new version has taken over
        end = time.monotonic() + config.bus.connect_timeout_s
        for fuser in fusers.values():  # a stream that is on is answered by the channels there are
            fuser.channels.wait_for_all(
                end - time.monotonic(), lambda: stop.is_set() or inbox.is_waiting
            )

        def after_batch(run: str) -> None:
            for version, is_there in new_versions():
                for fuser in fusers.values():
                    fuser.offer(version, is_there)
            fusers[run].release()
            process.maps[run] = fusers[run].digest

        with process.sole():
            process.serve(
                inbox,
                lambda received: fusers[received.run].handle(received),
                stop,
                after_batch=after_batch,
            )


def _shared(bus: Bus, keys: Keys, key: str) -> CachedPublisher:
    """Return what publishes on a key and shares what it remembers."""
    cache = ReplayCache()
    serve_cache(bus, keys.cache(key), cache)
    return CachedPublisher(bus.publisher(key), cache)
