"""Services refuse messages of another map, even if it is very similar."""

import hashlib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from bus_doubles import header, received
from channel_stage import RUNS
from channel_stage import Stage as WorkerStage
from fuser_stage import CANDIDATES, CHANNELS, LAG, Clock, Stage

from placefield.bus.candidate_messages import ChannelPartial, HaloMessage, SmoothedFrame
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.refusing import count_refused
from placefield.errors import MapError, MessageError, OtherMapError
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_services import fuser_run as fuser_module

OTHER = {"map": "f" * 16}


@pytest.fixture
def stage(route_map: Map, monkeypatch: pytest.MonkeyPatch) -> Stage:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    return Stage(route_map, clock)


@pytest.mark.parametrize("is_end", [False, True])
def test_a_fuser_refuses_candidates_of_another_map_and_accepts_its_own(
    stage: Stage, *, is_end: bool
) -> None:
    stage.announce(header(0))
    about = header(1, end=True) if is_end else header(0)
    sent = stage.message_of_smoothed(
        about, *(stage.smoothed(channel, 0, 0) for channel in range(CHANNELS))
    )
    with pytest.raises(OtherMapError, match="of map ffffffffffffffff, not "):
        stage.handle(CANDIDATES, about, sent.model_copy(update=OTHER))
    assert not stage.published
    stage.answer(tuple(range(CHANNELS)), header(0))
    assert stage.published == [(0, stage.expected(0))]
    assert stage.matches.sent[0][1].model_dump()["map"] == stage.map


def test_a_fuser_that_resumes_a_stream_counts_cached_messages_of_another_map(
    stage: Stage,
) -> None:
    for sequence in range(4):
        smoothed = SmoothedFrame(0, sequence, 0, stage.candidate(0, sequence))
        sent = stage.message_of_smoothed(header(sequence), smoothed).model_copy(update=OTHER)
        stage.remembered.append((header(sequence), sent.encode()))
    stage.announce(header(4, oldest=4))
    assert stage.counts["other_map"] == LAG
    assert stage.counts["malformed"] == 0


def test_candidates_of_another_map_that_were_faster_than_the_descriptor_are_counted(
    stage: Stage,
) -> None:
    candidates = stage.message(stage.written(0, 0)).model_copy(update=OTHER)
    with pytest.raises(OtherMapError):
        stage.handle(CANDIDATES, header(0), candidates)
    stage.announce(header(0))
    stage.answer(tuple(range(CHANNELS)), header(0))
    assert stage.published == [(0, stage.expected(0))]


def test_a_worker_says_which_map_it_has_and_refuses_partial_results_of_another(
    route_map: Map,
) -> None:
    stage = WorkerStage(route_map, "filter")
    stage.send(header(0), None)
    stage.send(header(1, end=True), None)
    sent = [message for _, message in stage.publishers[RUNS[0]].sent]
    assert [message.model_dump()["map"] for message in sent if message] == [route_map.digest] * 2
    partial = ChannelPartial(channel=0, partial=route_map.places.travelled[:1])
    halo = HaloMessage(**OTHER, shard=0, shards=2, partials=(partial,))
    with pytest.raises(OtherMapError):
        stage.handle(_halo(halo))


def _halo(message: HaloMessage) -> Received:
    return received(Keys(RUNS[0]).halo("untrusted"), header(0), message)


@pytest.mark.parametrize(
    ("error", "counted"), [(MessageError("x"), "malformed"), (OtherMapError("x"), "other_map")]
)
def test_a_message_of_another_map_has_a_count_of_its_own(error: MessageError, counted: str) -> None:
    counts: Counter[str] = Counter()
    count_refused(counts, error)
    assert counts == {counted: 1}


def test_a_map_that_differs_in_a_seed_alone_is_another(route_map: Map, tmp_path: Path) -> None:
    one, other = tmp_path / "one.pfmap", tmp_path / "other.pfmap"
    save_map(route_map, one)
    save_map(replace(route_map, seed=route_map.seed + 1), other)
    written = (one / "manifest.json").read_bytes()
    assert open_map(one).digest == hashlib.sha256(written).hexdigest()[:16]
    assert open_map(other).digest != open_map(one).digest
    assert open_map(one, lineage=route_map.lineage).lineage == open_map(other).lineage
    with pytest.raises(MapError, match=r"one\.pfmap: is no version of the served map"):
        open_map(one, lineage="f" * 16)


def test_a_fuser_answers_no_more_once_its_map_was_written_to(
    route_map: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, written = Clock(), []

    def check_unchanged() -> None:
        if written:
            raise MapError("was written to")

    monkeypatch.setattr(fuser_module, "time", clock)
    stage = Stage(replace(route_map, check_unchanged=check_unchanged), clock)
    for sequence in range(2):
        stage.announce(header(sequence))
        if sequence == 1:
            written.append("poses")
            with pytest.raises(MapError):
                stage.answer(tuple(range(CHANNELS)), header(sequence))
        else:
            stage.answer(tuple(range(CHANNELS)), header(sequence))
    assert stage.published == [(0, stage.expected(0))]
