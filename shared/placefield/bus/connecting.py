"""Opens sessions on the bus: a client of a router, or the router of this host."""

import itertools
import logging
import random
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from placefield.bus.credentials import access_control
from placefield.bus.session import Bus
from placefield.bus.settings import (
    VIEWERS,
    client_settings,
    is_local,
    router_settings,
    zenoh_config,
)
from placefield.config import BusConfig
from placefield.errors import BusError

log = logging.getLogger(__name__)

_ATTEMPT_S = 0.5


@contextmanager
def open_bus(
    config: BusConfig, stop: threading.Event | None = None, *, viewer: bool = False
) -> Iterator[Bus]:
    """Open a client session; it is closed at the end of the block.

    Args:
        config: where the router is, and how long to wait for it.
        stop: ends the wait.
        viewer: whether the session only reads. The router does not wait for a viewer: it drops the
            messages that a viewer does not accept in time. Eight viewers are possible; any more are
            treated as other clients.

    Raises:
        BusError: the endpoint is malformed, the credentials do not fit, or no router answered
            before the wait ended.
    """
    settings = client_settings(config, _ATTEMPT_S)
    hint = "start one with 'placefield up MAP', or name another with --endpoint"
    if config.credentials:
        hint += "; if one is there, it refuses these credentials"
    attempts = _attempts(config, settings, stop, VIEWERS if viewer else ())
    with _open(attempts, f"no router at {config.endpoint}: {hint}") as bus:
        yield bus


def _attempts(
    config: BusConfig,
    settings: dict[str, Any],
    stop: threading.Event | None,
    identities: Sequence[str],
) -> Iterator[zenoh.Config]:
    """Yield a configuration for each attempt to open a session, at least one, until the wait ends.

    Each attempt is short, because no signal is handled inside it. If there are identities, two
    thirds of the attempts use one of them; the others use none, as all identities may be in use.
    """
    end = time.monotonic() + config.connect_timeout_s
    for attempt in itertools.count():
        as_one = {"id": random.choice(identities)} if identities and attempt % 3 < 2 else {}
        yield zenoh_config(config, settings | as_one)
        if time.monotonic() > end or (stop and stop.is_set()):
            return


@contextmanager
def open_router(config: BusConfig) -> Iterator[Bus]:
    """Open a session that is the router of this host and listens at the endpoint.

    The router connects to the routers of other hosts in ``bus.connect`` as soon as they answer.

    With credentials the router accepts only clients with a certificate, and each client may do what
    its role allows. Without credentials it accepts every client that reaches the endpoint.

    Raises:
        BusError: the endpoint is malformed or in use, or the credentials do not fit.
    """
    settings = router_settings(config)
    if config.credentials:
        settings["access_control"] = access_control(Path(config.credentials))
    made = zenoh_config(config, settings)
    if not config.credentials and not is_local(config.endpoint):
        log.warning(
            "%s: any client that reaches it may read and publish; "
            "see 'placefield security init -h'",
            config.endpoint,
        )
    hint = "is another router running there? Name another with --endpoint"
    with _open(iter([made]), f"cannot listen at {config.endpoint}: {hint}") as bus:
        yield bus


@contextmanager
def _open(attempts: Iterator[zenoh.Config], failure: str) -> Iterator[Bus]:
    for attempt in attempts:
        try:
            session = zenoh.open(attempt)
        except zenoh.ZError as error:
            log.debug("zenoh: %s", error)
            continue
        with session:
            yield Bus(session)
        return
    raise BusError(failure)
