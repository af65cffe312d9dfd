"""Thousands of tokens of an untrusted client stop neither the status nor a run."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from hosting import Host, Listener, answers_of, offline, placefield

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.maps.map import Map

KEYS = Keys("default")
TOKENS = [
    *(KEYS.alive("channel", f"{number}-x{number}") for number in range(1000)),
    *(KEYS.alive("channel", f"0.{number}of99999-x") for number in range(500)),
    *(KEYS.alive("nobody", f"x{number}") for number in range(500)),
]


@pytest.fixture
def untrusted_client(host: Host) -> Iterator[Bus]:
    with open_bus(BusConfig(endpoint=host.endpoint)) as bus:
        yield bus


@pytest.mark.timeout(120)
def test_thousands_of_tokens_stop_neither_status_nor_a_replay(
    host: Host, listener: Listener, untrusted_client: Bus, route_map: Map, query_dir: Path
) -> None:
    for token in TOKENS:
        untrusted_client.declare_alive(token)
    at = ("--endpoint", host.endpoint)
    status = placefield("status", "--json", *at)
    report = json.loads(status.stdout)
    assert len(report["services"]) >= len(TOKENS)
    assert {"featurizer", "fuser"} <= {each["service"] for each in report["services"]}
    assert placefield("alive", "fuser", *at).returncode == 0
    ended = host.replay(query_dir)
    assert ended.returncode == 0, ended.stderr
    assert answers_of(listener.answers()) == offline(route_map, sorted(query_dir.iterdir()))


@pytest.mark.parametrize("count", [255, 257, 3000])
def test_tokens_are_looked_up_while_they_are_watched(host: Host, count: int) -> None:
    with (
        open_bus(BusConfig(endpoint=host.endpoint)) as there,
        open_bus(BusConfig(endpoint=host.endpoint)) as here,
    ):
        keys = Keys("elsewhere")
        here.watch_alive(keys.all_alive(), lambda key, is_alive: None)
        for number in range(count):
            there.declare_alive(keys.alive("nobody", f"x{number}"))
        found: set[str] = set()
        while len(found) < count:
            found = here.alive(keys.all_alive())
        assert found == {keys.alive("nobody", f"x{number}") for number in range(count)}
