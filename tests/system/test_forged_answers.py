"""Forged answers of an untrusted client to frames under way change nothing."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from hosting import Host, Listener, answers_of, offline, placefield, wait_until

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map

KEYS = Keys("default")

NOT_DUE = {"one": 0, "each": 1, "end": 1, "beyond": 60, "match": 12}
"""The fewest answers and matches of a kind that are counted: on a busy machine, a forged answer may
come after the match that it stands for, and is then valid like the fuser's."""


@pytest.fixture
def untrusted_client(host: Host) -> Iterator[Bus]:
    with open_bus(BusConfig(endpoint=host.endpoint)) as bus:
        yield bus


class Forger:
    """Answers each frame as it is sent, before the services."""

    def __init__(self, bus: Bus, kind: str) -> None:
        self._kind = kind
        self._acks, self._matches = bus.publisher(KEYS.ack), bus.publisher(KEYS.match)
        self.received = self.forged = 0
        bus.subscribe(KEYS.frame, self._forge, Counter())

    def _forge(self, received: Received) -> None:
        header = received.header
        self.received += 1
        if header.end and self._kind != "end":
            return
        for forged in self._forgeries(header):
            self._acks.put(forged)
            self.forged += 1
        if self._kind == "match" and header.sequence % 5 == 1:
            self._matches.put(header, MatchMessage(map=NO_DIGEST, place=0, score=9.0))
            self.forged += 1

    def _forgeries(self, header: Header) -> Sequence[Header]:
        match self._kind:
            case "one":
                return [header] if header.sequence == 20 else []
            case "each":
                return [header]
            case "end":
                end = header.model_copy(update={"end": True, "sequence": header.sequence + 1})
                return [end, header]
            case "beyond":
                return [header.of_frame(header.sequence + 1), header.of_frame(2**40)]
        return []


@pytest.mark.parametrize("kind", ["one", "each", "end", "beyond", "match"])
def test_forged_answers_leave_each_frame_matched_and_the_source_knows(
    host: Host,
    listener: Listener,
    untrusted_client: Bus,
    route_map: Map,
    query_dir: Path,
    kind: str,
) -> None:
    before = matches_of_fuser(host) if kind == "match" else 0
    forger = Forger(untrusted_client, kind)
    ended = host.replay(query_dir)
    assert ended.returncode == 0, ended.stderr
    assert "60 frames replayed" in ended.stdout
    if kind == "match":  # the answers have forged ones among them
        wait_until(lambda: matches_of_fuser(host) == before + 60, "no frame was passed over")
    else:
        answered = listener.answers()
        assert answers_of(answered) == offline(route_map, sorted(query_dir.iterdir()))
    wait_until(lambda: forger.received >= 61, "the forger has all frames and the end")
    sent_again = forger.received - 61  # a busy machine answers and matches those twice
    counted = re.search(r"(\d+) answers or matches were not due", ended.stderr)
    not_due = int(counted[1]) if counted else 0
    assert NOT_DUE[kind] <= not_due <= forger.forged + 2 * sent_again


def matches_of_fuser(host: Host) -> int:
    status = placefield("status", "--json", "--endpoint", host.endpoint)
    services = json.loads(status.stdout)["services"]
    fuser = next(each for each in services if each["service"] == "fuser")
    return int(fuser["counts"].get("matches", 0))
