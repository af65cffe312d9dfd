"""The Zenoh settings of a session on the bus."""

import json
import re
from typing import Any

import zenoh

from placefield.bus.credentials import encryption
from placefield.bus.keys import ROOT
from placefield.bus.message import MAX_BYTES
from placefield.config import BusConfig
from placefield.errors import BusError

_RETRY = {"period_init_ms": 100, "period_max_ms": 1000}
_ENDPOINT = re.compile(r"(?!(tcp|tls|udp|quic|ws)/).+/.+|\w+/.+:[0-9]+([#?].*)?")
"""A protocol and an address; an internet protocol also needs a port."""

VIEWERS = tuple(f"{'77' * 15}{number:02x}" for number in range(1, 9))
"""The identities of viewers. The router does not wait for them: it drops messages instead."""


def router_settings(config: BusConfig) -> dict[str, Any]:
    """Return Zenoh's settings for a router at the endpoint, by setting path, no access control.

    Raises:
        BusError: the credentials do not fit.
    """
    return _settings(config, "router", "listen") | {
        "scouting/delay": 0,
        "connect/endpoints": config.connect,
        "connect/retry": _RETRY,
        "qos/network": [
            {
                "id": "viewers",
                "zids": VIEWERS,
                "flows": ["egress"],
                "messages": ["put"],
                "key_exprs": [f"{ROOT}/**"],
                "overwrite": {"congestion_control": "drop"},
            }
        ],
    }


def client_settings(config: BusConfig, timeout_s: float) -> dict[str, Any]:
    """Return Zenoh's settings for a client that gives up connecting after ``timeout_s`` seconds.

    Raises:
        BusError: the credentials do not fit.
    """
    return _settings(config, "client", "connect") | {
        "connect/timeout_ms": round(timeout_s * 1000),
        "connect/retry": _RETRY,
    }


def _settings(config: BusConfig, mode: str, use: str) -> dict[str, Any]:
    return encryption(config) | {
        "mode": mode,
        f"{use}/endpoints": [config.endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/buffer_size": 4 * 2**20,
        "transport/link/rx/max_message_size": MAX_BYTES,
    }


def is_local(endpoint: str) -> bool:
    """Return whether only processes of this host can reach an endpoint."""
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    return host == "localhost" or host == "::1" or host.startswith("127.")


def zenoh_config(config: BusConfig, settings: dict[str, Any]) -> zenoh.Config:
    """Make a Zenoh configuration from settings.

    Raises:
        BusError: an endpoint is malformed.
    """
    made = zenoh.Config()
    try:
        for endpoint in (config.endpoint, *config.connect):
            if not _ENDPOINT.fullmatch(endpoint):
                raise ValueError(endpoint)
        for key, value in settings.items():
            made.insert_json5(key, json.dumps(value))
    except (ValueError, zenoh.ZError):
        given = f"bus.endpoint {config.endpoint!r}"
        if config.connect:
            given += f" or bus.connect {', '.join(map(repr, config.connect))}"
        raise BusError(f"{given} is malformed: write it as tcp/HOST:PORT") from None
    return made
