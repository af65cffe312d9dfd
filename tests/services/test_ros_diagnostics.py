from typing import Any

import pytest
from ros_doubles import RecordingTopic

from placefield.bus.keys import Keys
from placefield.bus.messages import StatsMessage
from placefield.errors import MessageError
from placefield.ros.ros_messages import DIAGNOSTICS, OK, STALE, WARN
from placefield_services import ros_diagnostics
from placefield_services.ros_diagnostics import Diagnostics

KEYS = Keys("run")


class Stage:
    """Diagnostics with a simulated clock, and their published messages."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(ros_diagnostics.time, "monotonic", lambda: self.now)
        self.topic = RecordingTopic(DIAGNOSTICS)
        self.diagnostics = Diagnostics("run", self.topic)

    def report(self, service: str = "fuser", identity: str = "ab", **counts: int) -> None:
        stats = StatsMessage(service=service, counts=counts, stream="s", sequence=8)
        self.diagnostics.receive(KEYS.stats(service, identity), stats.encode())

    def after(self, seconds: float) -> list[Any]:
        """Return the statuses that are published after a time."""
        self.now += seconds
        self.topic.sent.clear()
        self.diagnostics.publish()
        (sent,) = self.topic.sent
        return list(sent.status)


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Stage:
    return Stage(monkeypatch)


def test_each_process_has_a_status_with_its_counts(stage: Stage) -> None:
    stage.report("fuser", "cd", matches=3)
    stage.report("featurizer", "ab", received=4)
    featurizer, fuser = stage.after(1)
    assert (featurizer.name, featurizer.hardware_id) == ("placefield: featurizer ab", "run")
    assert (fuser.name, fuser.level, fuser.message) == ("placefield: fuser cd", OK, "ok")
    values = {pair.key: pair.value for pair in fuser.values}
    assert values == {"matches": "3", "newest_frame": "8"}


def test_only_new_trouble_is_a_warning(stage: Stage) -> None:
    stage.report(late=5)
    assert stage.after(1)[0].level == OK  # it was before anybody listened
    stage.report(late=6, matches=9)
    stage.report(late=7, partial=1, matches=10)  # it may report twice between two statuses
    (warned,) = stage.after(1)
    assert (warned.level, warned.message) == (WARN, "2 late, 1 partial")
    stage.report(late=7, partial=1, matches=11)
    assert stage.after(1)[0].level == OK


def test_a_process_that_is_silent_is_stale_and_then_forgotten(stage: Stage) -> None:
    stage.report(matches=1)
    assert stage.after(2.9)[0].level == OK
    assert stage.after(1)[0].level == STALE
    assert stage.after(60) == []


def test_they_are_published_once_a_second(stage: Stage) -> None:
    for _ in range(35):
        stage.diagnostics.publish()
        stage.now += 0.1
    assert len(stage.topic.sent) == 4


def test_a_malformed_message_of_statistics_is_refused(stage: Stage) -> None:
    with pytest.raises(MessageError):
        stage.diagnostics.receive(KEYS.stats("fuser", "ab"), b"garbage")
