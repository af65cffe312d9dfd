"""The channel worker: it receives descriptors and publishes the candidates of its channels."""

import threading
from collections.abc import Sequence
from functools import cache

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import CAPACITY, Inbox
from placefield.bus.keys import Part
from placefield.config import Config
from placefield.errors import ConfigError
from placefield.maps.map import Map
from placefield_services.channel_outputs import channel_outputs
from placefield_services.channel_worker import ChannelWorker
from placefield_services.map_versions import MapVersions, PreparedVersions
from placefield_services.moments import cache_moments
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.served_channels import ServedChannels

SERVICE = "channel"

_LIVE_FEATURES = 4  # live descriptors of a run that may wait; older ones are dropped


def run_channels(
    versions: MapVersions,
    channels: Sequence[int],
    config: Config,
    stop: threading.Event,
    *,
    shard: int = 0,
    shards: int = 1,
) -> None:
    """Serve channels of a map, or one shard of each channel, until ``stop`` is set.

    Raises:
        MapError: the map cannot be opened.
        ConfigError: the map has no such channel or has fewer places than shards, or the rule does
            not support its descriptors.
    """

    def prepare(placemap: Map) -> ServedChannels:
        _check(placemap, channels, config)
        served = ServedChannels(placemap, channels, config.matching, shard, shards)
        served.warm_up()
        return served

    first = prepare(versions.open())
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        # All shards of a channel must match the same frames, so a shard may not drop one.
        inbox = Inbox(process.counts, live_capacity=_LIVE_FEATURES if shards == 1 else CAPACITY)
        outputs = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            if shards > 1:
                bus.subscribe(keys.all_halos, inbox.offer, process.counts[run])
            cache_moments(bus, keys, process.counts[run])
            outputs[run] = channel_outputs(
                bus, keys, process.identity, config.matching.lag, process.counts[run]
            )
        worker = ChannelWorker(first, outputs, process.counts)
        del first  # so that it is freed when a new version has taken over

        @cache
        def follow_fusers() -> None:
            """From the first new version on, receive matches, which say the versions of fusers."""
            for run, keys in process.keys.items():
                bus.subscribe(keys.match, worker.answering[run].receive, process.counts[run])

        prepared = PreparedVersions(versions, prepare)

        def after_batch(run: str) -> None:
            for served in prepared.pop_all():
                worker.offer(served)
                follow_fusers()
            worker.after_batch(run)
            process.answers[run], process.maps[run] = worker.newest_answers(run)

        for channel in channels:
            process.declare_ready(Part(channel, shard, shards).identity(process.identity))
        process.serve(inbox, worker.accept, stop, work=worker.match, after_batch=after_batch)


def _check(placemap: Map, channels: Sequence[int], config: Config) -> None:
    """Refuse a map that cannot be served.

    Raises:
        ConfigError: the map has no such channel, or the rule does not support its descriptors.
    """
    placemap.features.check_rule(config.matching.rule)
    for channel in channels:
        if channel >= len(placemap.channels):
            raise ConfigError(
                f"--channel {channel}: the map has channels 0 to {len(placemap.channels) - 1}"
            )
