"""Four hosts, a router on each: the camera's, two of channel workers, and the fuser's."""

import json
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hosting import PATIENCE_S, PLACEFIELD, Process, offline, wait_until
from namespaces import NamespaceProcess, Namespaces, namespaces

from placefield.config import BusConfig
from placefield.maps.map import Map

HOSTS = ("camera", "two-workers", "one-worker", "fuser")
PORT = BusConfig().endpoint.rpartition(":")[2]
SERVICES = {
    "camera": [["featurizer"]],
    "two-workers": [["channel", "--channel", "0"], ["channel", "--channel", "1"]],
    "one-worker": [["channel", "--channel", "2"]],
    "fuser": [["fuser"]],
}
PATIENT = ("--set", f"bus.connect_timeout_s={PATIENCE_S:g}")
"""All start at once: a service waits for its router, and the fuser for all channels."""

WIDE, COUNT = 12_500, 100  # a descriptor's values; of such features
_PUBLISH_WIDE_FEATURES = f"""
import numpy as np
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
wide = FeatureMessage(model="0" * 64, descriptor=np.zeros({WIDE}, np.float32))
with open_bus(BusConfig()) as bus:
    publisher = bus.publisher(Keys("default").feature)
    for number in range({COUNT}):
        publisher.put(Header(stream="wide", sequence=number, stamp_ns=0), wide)
"""


CUT_S, RATE = 4.0, 10.0
"""How long a link is cut, twice the deadline of a frame, and frames a second meanwhile."""


@dataclass
class Network:
    """The hosts and what runs on them."""

    hosts: Namespaces
    logs: Path

    def placefield(self, host: str, *arguments: str | Path) -> str:
        ended = self.hosts.run(host, *PLACEFIELD, *arguments)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    def is_alive(self, host: str, *service: str) -> bool:
        return self.hosts.run(host, *PLACEFIELD, "alive", *service).returncode == 0

    def reaches(self, host: str, other: str) -> bool:
        router = f"tcp/{self.hosts.address(other)}:{PORT}"
        return self.is_alive(host, "--endpoint", router, "--set", "bus.connect_timeout_s=0.5")

    def received(self) -> dict[str, int]:
        return {host: self.hosts.received(host) for host in HOSTS}


@pytest.fixture(scope="module")
def network(logs: Path, map_path: Path) -> Iterator[Network]:
    with ExitStack() as running:
        hosts = running.enter_context(namespaces(HOSTS))
        network = Network(hosts, logs)
        for number, host in enumerate(HOSTS):
            others = [f"--connect=tcp/{hosts.address(other)}:{PORT}" for other in HOSTS[:number]]
            routing = ("router", "--endpoint", f"tcp/0.0.0.0:{PORT}", *others)
            running.enter_context(NamespaceProcess(logs, hosts, host, *routing))
            for service, *flags in SERVICES[host]:
                serving = (service, map_path, *flags, *PATIENT)
                running.enter_context(NamespaceProcess(logs, hosts, host, *serving))
        wait_until(lambda: network.is_alive("camera", "fuser"), "all services are alive")
        yield network


def test_a_stream_through_four_hosts_gives_what_is_given_offline(
    network: Network, route_map: Map, query_dir: Path
) -> None:
    with NamespaceProcess(network.logs, network.hosts, "fuser", "listen", "--json") as listening:
        wait_until(lambda: _is_connected(network, "fuser", listening), "it listens")
        assert "60 frames replayed" in network.placefield("camera", "replay", query_dir)
        wait_until(lambda: len(_at_once(listening)) > 60, "every frame is answered")
        answers = _at_once(listening)
    assert [answer["sequence"] for answer in answers] == [*range(61)]
    matches = [(a["place"], a["score"], tuple(a["missing"])) for a in answers if not a["end"]]
    assert matches == offline(route_map, sorted(query_dir.iterdir()))


def test_a_feature_crosses_to_a_host_once_however_many_read_it_there(network: Network) -> None:
    before = network.received()
    published = network.hosts.run("camera", sys.executable, "-c", _PUBLISH_WIDE_FEATURES)
    assert published.returncode == 0, published.stderr
    features = COUNT * WIDE * 4
    readers = HOSTS[1:]
    wait_until(
        lambda: all(network.received()[host] - before[host] >= features for host in readers),
        "all features have come",
    )
    network.placefield("fuser", "status")  # what came twice would have come by then
    came = {host: network.received()[host] - before[host] for host in HOSTS}
    for host in readers:
        assert came[host] < 1.1 * features, came
    assert came["camera"] < 0.1 * features, came


def _at_once(listening: Process) -> list[dict[str, Any]]:
    """Return what was printed of matches that are not smoothed ones, and of the end."""
    lines = [line for line in listening.out.splitlines(keepends=True) if line.endswith("\n")]
    return [match for line in lines if not (match := json.loads(line))["smoothed"]]


def _is_connected(network: Network, host: str, process: Process) -> bool:
    shown = network.hosts.run(host, "ss", "-Htnp", "state", "established", f"dport = :{PORT}")
    return f"pid={process.pid}," in shown.stdout


def test_a_cable_can_be_pulled_and_plugged_in_again(network: Network, query_dir: Path) -> None:
    network.hosts.cut("one-worker")
    assert not network.reaches("fuser", "one-worker")
    assert network.reaches("fuser", "two-workers")
    network.hosts.mend("one-worker")
    assert network.reaches("fuser", "one-worker")
    assert "60 frames replayed" in network.placefield("camera", "replay", query_dir)


def test_a_cable_that_is_pulled_in_a_stream_costs_flags_and_no_frame(
    network: Network, route_map: Map, query_dir: Path, tmp_path: Path
) -> None:
    twice = tmp_path / "twice"
    twice.mkdir()
    for lap in range(2):
        for file in query_dir.iterdir():
            (twice / f"{lap}-{file.name}").symlink_to(file)
    replaying = "replay", twice, "--rate", f"{RATE:g}"
    with NamespaceProcess(network.logs, network.hosts, "fuser", "listen", "--json") as listening:
        wait_until(lambda: _is_connected(network, "fuser", listening), "it listens")
        with NamespaceProcess(network.logs, network.hosts, "camera", *replaying) as replay:
            wait_until(lambda: len(_at_once(listening)) > 10, "the stream is on")
            network.hosts.cut("one-worker")
            before = len(_at_once(listening))
            time.sleep(CUT_S)
            during = len(_at_once(listening)) - before
            network.hosts.mend("one-worker")
            wait_until(lambda: not replay.runs, "the replay is over")
        wait_until(lambda: len(_at_once(listening)) > 120, "every frame is answered")
        answers = _at_once(listening)
    assert [answer["sequence"] for answer in answers] == [*range(121)]
    undisturbed = offline(route_map, sorted(twice.iterdir()))
    matches = [(a["place"], a["score"], tuple(a["missing"])) for a in answers if not a["end"]]
    flagged = [number for number, (_, _, missing) in enumerate(matches) if missing]
    assert during > RATE * CUT_S / 4  # of the frames of that time, even on a busy machine
    assert flagged
    assert {matches[number][2] for number in flagged} == {(2,)}
    assert flagged[-1] < 119
    whole = [number for number in range(120) if number not in flagged]
    assert [matches[number] for number in whole] == [undisturbed[number] for number in whole]
