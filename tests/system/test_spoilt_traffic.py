"""Thousands of messages that are not what they should be, and what is left of them afterwards."""

import time
from collections.abc import Mapping
from pathlib import Path

import psutil
from hosting import Host, Listener, answers_of, offline, wait_until

from placefield.bus.inbox import Received
from placefield.bus.session import open_bus
from placefield.config import BusConfig
from placefield.maps.map import Map
from placefield_tools.chaos.garbage import (
    SPOILERS,
    ReceivedTraffic,
    declare_unknown_services,
    publish,
    query,
)

SERVICES = ("featurizer", "channel", "fuser")
MALFORMED = ("noise", "cut", "another version", "other values", "large")
EACH = 1000
GROWTH = 64 * 2**20
"""Bytes that a process may grow by, however many messages come: queues and allocators fill up."""


def record_a_replay(
    received: ReceivedTraffic, host: Host, query_dir: Path
) -> dict[str, list[Received]]:
    host.replay(query_dir)
    wait_until(
        lambda: sum("/stats/" in topic for topic in received.topics) >= 4, "counts are received"
    )
    return dict(received.topics)


def wait_until_digested(listener: Listener) -> None:
    def received() -> list[int]:
        return [listener.count(service, "received") for service in SERVICES]

    def rests() -> bool:
        before = received()
        time.sleep(2.2)  # counts come once a second
        return received() == before

    wait_until(rests, "all is digested")


def memory(host: Host) -> dict[int, int]:
    processes = [psutil.Process(host.pid), *host.children()]
    return {process.pid: process.memory_info().rss for process in processes}


def sent_to(published: Mapping[tuple[str, str], int], part: str) -> int:
    return sum(
        count
        for (key, sort), count in published.items()
        if sort in MALFORMED and key.split("/")[2] == part
    )


def test_thousands_of_bad_messages_change_no_answer_take_no_memory_and_are_counted(
    logs: Path, map_path: Path, route_map: Map, query_dir: Path
) -> None:
    expected = offline(route_map, sorted(query_dir.iterdir()))
    with Host(logs, map_path, "--workers", "2") as host:
        with open_bus(BusConfig(endpoint=host.endpoint)) as bus, host.listener() as listener:
            keys = listener.keys
            received = record_a_replay(ReceivedTraffic(bus, keys), host, query_dir)
            declare_unknown_services(bus, keys)
            publish(bus, received, 300, seed=1)
            wait_until_digested(listener)
            before = memory(host)
            published = publish(bus, received, EACH, seed=2)
            replies = list(query(bus, keys.cache(keys.feature), 4, seed=3))
            wait_until_digested(listener)
            after = memory(host)
        assert sum(published.values()) == EACH * len(SPOILERS)
        assert not replies
        with host.listener() as listener:
            host.replay(query_dir)
            assert answers_of(listener.answers()) == expected
            wait_until(lambda: all(listener.count(s, "received") for s in SERVICES), "counts")
            for service, part in zip(SERVICES, ("frame", "feature", "candidate"), strict=True):
                dropped = ("malformed", "other_map", "dropped_full", "dropped_old")
                counted = sum(listener.count(service, name) for name in dropped)
                assert counted >= sent_to(published, part) / 2, service
                assert not listener.count(service, "failed"), service
        assert before.keys() == after.keys(), "a process died"
        assert all(after[pid] - before[pid] < GROWTH for pid in before), (before, after)
        assert "Traceback" not in host.err
        assert host.err.count("\n") < 200
