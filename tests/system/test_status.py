import json
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from hosting import Host, Process, placefield, wait_until

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys, Part
from placefield.bus.messages import StatsMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig


def complaint(ended: "subprocess.CompletedProcess[str]") -> str:
    """Return the one line in which status says what is missing, below what there is."""
    assert ended.returncode == 1, ended
    [line] = ended.stderr.splitlines()
    return line


def test_status_reports_how_far_each_service_of_a_whole_run_is(host: Host, query_dir: Path) -> None:
    host.replay(query_dir)
    ended = placefield("status", "--json", "--endpoint", host.endpoint)
    assert ended.returncode == 0, ended.stderr
    report = json.loads(ended.stdout)
    assert report["run"] == "default"
    assert report["channels"] == 3
    assert report["missing"] == []
    assert report["newest"] == 60  # the end: so many frames
    services = [s for s in report["services"] if s["service"] in ("featurizer", "channel", "fuser")]
    assert len(services) == 1 + 3 + 1
    assert sorted(s["part"]["channel"] for s in services if s["part"]) == [0, 1, 2]
    for service in services:
        assert service["stream"] == report["stream"]
        assert (service["sequence"], service["behind"]) == (60, 0)
        assert not service["silent"]
        assert service["counts"]["received"] >= 60


def test_status_names_what_a_run_lacks_and_ends_with_code_1(host: Host) -> None:
    at = ("--endpoint", host.endpoint)
    empty_run = placefield("status", *at, "--run", "nobody")
    hint = "there is default: name one with --run"
    assert complaint(empty_run) == (
        f"placefield: run 'nobody' lacks featurizer; fuser; channel; {hint}"
    )

    with open_bus(BusConfig(endpoint=host.endpoint)) as bus, half_a_run(bus, Keys("half")):
        half = placefield("status", *at, "--run", "half")
    assert "run half" in half.stdout
    assert "0.1of2-ab" in half.stdout
    assert "matches 7" in half.stdout
    missing = "featurizer; channel 0, shard 0/2; channel 1"
    assert complaint(half) == f"placefield: run 'half' lacks {missing}"


def test_status_says_in_words_how_many_frames_were_faster_than_the_map_resolves(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")  # so that no cell is broken into lines
    with open_bus(BusConfig(endpoint=host.endpoint)) as bus, half_a_run(bus, Keys("half")):
        half = placefield("status", "--endpoint", host.endpoint, "--run", "half")
    assert "matches 7, 2 frames faster than the map resolves" in half.stdout


def test_watching_prints_to_a_file_and_ends_by_a_signal_that_the_parent_ignored(
    host: Host, logs: Path
) -> None:
    watching = Process(logs, "status", "--watch", "--endpoint", host.endpoint)
    with ExitStack() as stack:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a script does for `command &`
        try:
            stack.enter_context(watching)
        finally:
            signal.signal(signal.SIGINT, before)
        wait_until(lambda: watching.out.count("complete") > 1, "two rounds are printed")
        assert watching.stop(signal.SIGINT) == 0
    assert "run default" in watching.out
    assert not watching.err


@contextmanager
def half_a_run(bus: Bus, keys: Keys) -> Iterator[None]:
    """A fuser of two channels, and half of the first."""
    stats = StatsMessage(service="fuser", counts={"matches": 7, "too_fast": 2}, channels=2)
    over = threading.Event()

    def report_counts() -> None:
        while not over.wait(0.2):
            bus.put(keys.stats("fuser", "cd"), stats)

    bus.declare_alive(keys.alive("fuser", "cd"))
    bus.declare_alive(keys.alive("channel", Part(0, 1, 2).identity("ab")))
    reporter = threading.Thread(target=report_counts)
    reporter.start()
    try:
        yield
    finally:
        over.set()
        reporter.join()
