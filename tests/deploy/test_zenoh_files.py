"""A session is opened with each of the files, and they say what our own router does."""

import json
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.bus.settings import router_settings
from placefield.config import BusConfig
from placefield_tools.common.host_process import free_endpoint
from placefield_tools.security.folders import write_credentials

INSECURE = {
    "zenoh/loopback.json5": BusConfig(),
    "zenoh/several-hosts.json5": BusConfig(
        endpoint="tcp/0.0.0.0:7557", connect=("tcp/worker.example:7557",)
    ),
    "kubernetes/router.json5": BusConfig(endpoint="tcp/0.0.0.0:7557"),
}
ALIVE = Keys("test").alive("fuser", "here")


@pytest.fixture(scope="module")
def credentials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("credentials") / "all"
    write_credentials(folder, ["worker.example"], 1)
    return folder


def config_of(text: str) -> zenoh.Config:
    return zenoh.Config.from_json5(text)


def value(config: zenoh.Config, key: str) -> Any:
    return json.loads(config.get_json(key))


def assert_same(config: zenoh.Config, settings: dict[str, Any]) -> None:
    ours = zenoh.Config()
    for key, setting in settings.items():
        ours.insert_json5(key, json.dumps(setting))
    for key in settings:
        assert value(config, key) == value(ours, key), key


def assert_routes(text: str, listens_at: str, client: BusConfig) -> None:
    """Check that clients meet at a router of this configuration, moved to a free port.

    The router that it connects to is not there.
    """
    nobody = free_endpoint().partition("/")[2]
    config = config_of(text.replace("worker.example:7557", nobody))
    config.insert_json5("listen/endpoints", json.dumps([listens_at]))
    with zenoh.open(config), open_bus(client) as one, open_bus(client) as other:
        one.declare_alive(ALIVE)
        end = time.monotonic() + 60
        while other.alive(Keys("test").all_alive()) != {ALIVE}:
            assert time.monotonic() < end, "they did not meet"


@pytest.mark.parametrize("name", INSECURE)
def test_a_file_says_what_our_router_does(deploy: Path, name: str) -> None:
    text = (deploy / name).read_text()
    assert_same(config_of(text), router_settings(INSECURE[name]))


@pytest.mark.parametrize("name", INSECURE)
def test_clients_meet_at_a_router_of_each_file(deploy: Path, name: str) -> None:
    endpoint = free_endpoint()
    client = BusConfig(endpoint=endpoint)
    assert_routes((deploy / name).read_text(), endpoint, client)


def secured(deploy: Path, credentials: Path) -> str:
    """Return the secure file with the paths of our certificates."""
    text = (deploy / "zenoh" / "secure.json5").read_text()
    return text.replace("/etc/placefield/", f"{credentials}/")


def test_the_secure_file_says_what_our_router_with_credentials_does(
    deploy: Path, credentials: Path
) -> None:
    config = config_of(secured(deploy, credentials))
    own = credentials / "router"
    bus = BusConfig(
        endpoint="tls/0.0.0.0:7557",
        connect=("tls/worker.example:7557",),
        credentials=str(own),
    )
    assert_same(config, router_settings(bus))
    made = zenoh.Config.from_file(own / "router.json5")
    assert value(config, "access_control") == value(made, "access_control")


def test_clients_with_credentials_meet_at_a_secure_router(deploy: Path, credentials: Path) -> None:
    endpoint = free_endpoint().replace("tcp/", "tls/")
    client = BusConfig(endpoint=endpoint, credentials=str(credentials / "fuser"))
    assert_routes(secured(deploy, credentials), endpoint, client)
