"""The verifier: frames and smoothed matches in, smoothed matches after their verification out."""

import os
import threading
import time
from contextlib import suppress
from functools import partial

import cv2

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox
from placefield.bus.keys import Keys, service_and_identity
from placefield.bus.replay_cache import CachedPublisher, fetcher, replicated_cache
from placefield.bus.session import Bus
from placefield.config import Config
from placefield_services.live_verifiers import LiveVerifiers
from placefield_services.map_versions import MapVersions
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.verified_versions import VerifiedVersions
from placefield_services.verifier_run import VerifierLinks, VerifierRun

SERVICE = "verifier"

_NICE = 10  # the services that a match waits for come first
_IN_TURN_S = 0.5  # how long one run's matches are verified before another's


def run_verifier(versions: MapVersions, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set.

    Raises:
        MapError: the map cannot be opened.
        ConfigError: it has no local features, or the rule gives no probabilities.
    """
    with suppress(
        OSError
    ):  # a sandbox may forbid it, as ours of systemd does, which sets it itself
        os.nice(_NICE)
    cv2.setNumThreads(1)  # more verifiers use more cores
    served = VerifiedVersions(versions, config)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        inbox = Inbox(process.counts)
        runs = {}
        for run, keys in process.keys.items():
            elders = [_identity(token) for token in bus.alive(keys.all_alive(SERVICE))]
            verifiers = LiveVerifiers(process.identity, elders)
            bus.watch_alive(keys.all_alive(SERVICE), verifiers.change)
            links = _links(bus, keys)
            process.answers[run] = links.verified.cache
            counts = process.counts[run]
            runs[run] = VerifierRun(keys, partial(served.find, run), verifiers, links, counts)
            for key in (keys.frame, keys.smoothed, keys.verified):
                bus.subscribe(key, inbox.offer, counts)

        def after_batch(run: str) -> None:
            runs[run].ask_if_quiet()
            end = time.monotonic() + _IN_TURN_S
            while not (stop.is_set() or inbox.is_waiting) and time.monotonic() < end:
                if not runs[run].verify_next():
                    return

        process.declare_ready(process.identity)
        process.serve(
            inbox,
            lambda received: runs[received.run].accept(received),
            stop,
            after_batch=after_batch,
        )


def _links(bus: Bus, keys: Keys) -> VerifierLinks:
    verified = replicated_cache(bus, keys.cache(keys.verified))
    return VerifierLinks(
        CachedPublisher(bus.publisher(keys.verified), verified.cache),
        fetcher(bus, keys.cache(keys.smoothed)),
        verified.fetch,
    )


def _identity(token: str) -> str:
    return service_and_identity(token)[1]
