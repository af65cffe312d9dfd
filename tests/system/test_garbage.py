import random
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from hosting import Host, Listener, Process, answers_of, offline, placefield, wait_until

from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import StatsMessage
from placefield.maps.map import Map


class Vandal(threading.Thread):
    """Puts garbage on every topic of a run until stopped."""

    def __init__(self, session: zenoh.Session, keys: Keys, stream: str) -> None:
        super().__init__()
        self._session = session
        self._random = random.Random(5)
        self._enough = threading.Event()
        self.rounds = 0
        topics = [keys.frame, keys.feature, keys.candidates("a"), keys.match]
        # To a topic, the streams that headers name; an acknowledgement is a header and no more.
        self._streams = {key: [stream, "another"] for key in topics} | {
            keys.ack: ["another"],
            keys.stats("fuser", "vandal"): ["another"],
        }

    def run(self) -> None:
        while not self._enough.wait(0.02):
            self.rounds += 1
            for key, streams in self._streams.items():
                self._session.put(key, self._payload(), attachment=self._attachment(streams))
                self._session.delete(key)

    def stop(self) -> None:
        self._enough.set()
        self.join()

    def _payload(self) -> bytes:
        stats = StatsMessage(service="vandal", counts={}).encode()
        return self._random.choice([b"\xc1", self._random.randbytes(300), stats[:-1]])

    def _attachment(self, streams: list[str]) -> bytes | None:
        header = Header(
            stream=self._random.choice(streams),
            sequence=self._random.choice([0, 30, 59, 60, 2**40]),
            stamp_ns=0,
            live=self._random.random() < 0.5,
            end=self._random.random() < 0.2,
        )
        return self._random.choice([None, b"", self._random.randbytes(40), *3 * [header.encode()]])


@pytest.fixture
def session(host: Host) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{host.endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as opened:
        yield opened


def test_garbage_on_every_topic_changes_no_answer_and_is_counted(
    host: Host,
    listener: Listener,
    session: zenoh.Session,
    logs: Path,
    route_map: Map,
    damaged_dir: Path,
) -> None:
    services = ("featurizer", "channel", "fuser")
    before = {service: listener.count(service, "malformed") for service in services}
    at = ("--endpoint", host.endpoint)
    with Process(logs, "listen", *at) as listen:
        with Process(logs, "replay", damaged_dir, "--rate", "30", *at) as replay:
            first = listener.answers(count=1)
            vandal = Vandal(session, listener.keys, first[0][0].stream)
            vandal.start()
            try:
                rest = listener.answers(first=1)
                wait_until(lambda: not replay.runs, "the replay is over")
            finally:
                vandal.stop()
            assert "60 frames replayed" in replay.out, replay.err
            assert "Traceback" not in replay.err
        status = placefield("status", *at)
        assert listen.stop() == 0
        assert listen.out.count("\n") <= 121
        assert "Traceback" not in listen.err
    assert vandal.rounds > 20
    assert answers_of(first + rest) == offline(route_map, sorted(damaged_dir.iterdir()))
    wait_until(
        lambda: all(listener.count(s, "malformed") > before[s] + 20 for s in services),
        "it is counted",
    )
    assert not any(listener.count(service, "failed") for service in services)
    assert status.returncode == 0, status.stderr
    assert "malformed" in status.stdout
    assert "vandal" not in status.stdout
    assert "Traceback" not in host.err
