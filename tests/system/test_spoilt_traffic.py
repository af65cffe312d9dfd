"""Thousands of messages that are not what they should be, and what is left of them afterwards."""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import psutil
from hosting import Answer, Host, answers_of, offline, wait_until

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
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
REPLAYED = re.compile("[0-9a-f]{32}")  # the stream of a replay; spoilers make up other names
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


def answered(
    host: Host, received: Mapping[str, list[Received]], *replayed: str | Path
) -> list[Answer]:
    """Replay; return the answers to that, and not what the fuser owes to spoilt streams.

    Spoilt messages of the streams in ``received`` may come meanwhile.
    """
    spoilt = {each.header.stream for each in received[Keys("default").frame]}
    streams: set[str] = set()
    with open_bus(BusConfig(endpoint=host.endpoint)) as bus, host.listener() as listener:
        bus.subscribe(listener.keys.frame, lambda each: streams.add(each.header.stream), Counter())
        host.replay(*replayed)
        (own,) = set(filter(REPLAYED.fullmatch, streams)) - spoilt
        return listener.answers(stream=own)


def wait_until_digested(
    host: Host, received: Mapping[str, list[Received]], query_dir: Path
) -> None:
    """Wait until all channels answer a frame in time, after all that came before it."""

    def in_time() -> bool:
        ((_, match),) = answered(host, received, query_dir, "--stop", "1")
        return not match.missing

    wait_until(in_time, "all is digested")


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
        with open_bus(BusConfig(endpoint=host.endpoint)) as bus:
            keys = Keys("default")
            received = record_a_replay(ReceivedTraffic(bus, keys), host, query_dir)
            declare_unknown_services(bus, keys)
            publish(bus, received, 300, seed=1)
            wait_until_digested(host, received, query_dir)
            before = memory(host)
            published = publish(bus, received, EACH, seed=2)
            replies = list(query(bus, keys.cache(keys.feature), 4, seed=3))
            wait_until_digested(host, received, query_dir)
            after = memory(host)
        assert sum(published.values()) == EACH * len(SPOILERS)
        assert not replies
        assert answers_of(answered(host, received, query_dir)) == expected
        with host.listener() as listener:
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
