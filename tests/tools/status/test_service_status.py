import pytest

from placefield.bus.keys import Keys, Part
from placefield.bus.message import Header
from placefield.bus.messages import StatsMessage
from placefield_tools.status.service_status import (
    SILENT_S,
    RunRecord,
    RunStatus,
    ServiceStatus,
    counts_in_words,
    missing,
    other_runs,
)

KEYS = Keys("day")
WHOLE = ["featurizer/f1", "fuser/u1", "channel/0-c1", "channel/1-c1"]


def tokens(*names: str) -> set[str]:
    return {KEYS.alive(*name.split("/")) for name in names}


def announced(sequence: int, stream: str = "s") -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0)


def stats(
    service: str, sequence: int | None, stream: str | None = "s", channels: int | None = None
) -> StatsMessage:
    return StatsMessage(
        service=service,
        counts={"received": 9},
        stream=None if sequence is None else stream,
        sequence=sequence,
        channels=channels,
    )


def service_of(status: RunStatus, identity: str) -> ServiceStatus:
    [found] = [service for service in status.services if service.identity == identity]
    return found


@pytest.fixture
def record() -> RunRecord:
    return RunRecord()


def test_a_service_is_behind_by_what_had_been_announced_at_its_report(record: RunRecord) -> None:
    record.announce(announced(30))
    record.update("channel", "c1", stats("channel", 27), 5.0)
    record.announce(announced(55))  # until its next report
    record.update("fuser", "u1", stats("fuser", 55, channels=2), 5.9)
    status = record.status(tokens(*WHOLE), 6.0)
    assert (status.stream, status.newest, status.channels) == ("s", 55, 2)
    for identity in ("0-c1", "1-c1"):
        assert service_of(status, identity).behind == 3
        assert service_of(status, identity).sequence == 27
    assert service_of(status, "u1").behind == 0
    assert service_of(status, "0-c1").part == Part(0)
    assert not status.missing


def test_a_featurizer_is_behind_by_what_was_sent_and_the_others_by_what_it_described(
    record: RunRecord,
) -> None:
    record.announce_sent(announced(30))
    record.announce(announced(12))
    for service, process in (("featurizer", "f1"), ("channel", "c1"), ("fuser", "u1")):
        record.update(service, process, stats(service, 12), 5.0)
    status = record.status(tokens(*WHOLE), 6.0)
    assert service_of(status, "f1").behind == 18
    for identity in ("0-c1", "1-c1", "u1"):
        assert service_of(status, identity).behind == 0


def test_a_fuser_is_behind_by_what_all_channels_had_reported_not_by_what_it_waits_for(
    record: RunRecord,
) -> None:
    record.announce(announced(30))
    record.update("channel", "c1", stats("channel", 30), 5.0)
    record.update("channel", "c2", stats("channel", 14), 5.1)
    record.update("fuser", "u1", stats("fuser", 12), 5.2)
    record.update("channel", "c2", stats("channel", 30), 5.3)  # until the fuser's next report
    status = record.status(tokens(*WHOLE, "channel/2-c2"), 6.0)
    assert service_of(status, "u1").behind == 2
    record.update("fuser", "u1", stats("fuser", 12), 6.2)
    assert service_of(record.status(tokens(*WHOLE), 6.3), "u1").behind == 18


def test_a_silent_service_is_behind_by_all_that_came_since(record: RunRecord) -> None:
    record.announce(announced(30))
    record.update("channel", "c1", stats("channel", 30), 5.0)
    record.announce(announced(130))
    reporting = service_of(record.status(tokens("channel/0-c1"), 5.0 + SILENT_S), "0-c1")
    silent = service_of(record.status(tokens("channel/0-c1"), 5.1 + SILENT_S), "0-c1")
    assert (reporting.silent, reporting.behind) == (False, 0)
    assert (silent.silent, silent.behind) == (True, 100)


def test_a_service_without_a_report_is_silent_but_a_replay_need_not_report(
    record: RunRecord,
) -> None:
    status = record.status(tokens("fuser/u1", "replay/r1"), 1.0)
    assert [service.silent for service in status.services] == [True, False]
    assert all(service.behind is None for service in status.services)


def test_in_a_stream_that_rests_services_are_behind_the_one_that_is_furthest(
    record: RunRecord,
) -> None:
    record.update("channel", "c1", stats("channel", 4, "old"), 5.0)
    record.update("featurizer", "f1", stats("featurizer", 8, "new"), 5.1)
    record.update("fuser", "u1", stats("fuser", 6, "new"), 5.2)
    status = record.status(tokens(*WHOLE), 6.0)
    assert (status.stream, status.newest) == ("new", 8)
    assert service_of(status, "u1").behind == 2
    assert service_of(status, "f1").behind == 0
    assert service_of(status, "0-c1").behind is None  # it knows only the stream before


def test_the_rate_is_of_the_frames_between_two_reports_of_one_stream(record: RunRecord) -> None:
    def rate() -> float | None:
        return service_of(record.status(tokens("fuser/u1"), 5.0), "u1").rate

    rates = []
    for now, sequence, stream in ((1.0, 10, "s"), (3.0, 60, "s"), (4.0, 3, "t"), (4.5, 13, "t")):
        record.update("fuser", "u1", stats("fuser", sequence, stream), now)
        rates.append(rate())
    assert rates == [None, 25.0, None, 20.0]


def test_a_frame_announced_again_makes_none_newer(record: RunRecord) -> None:
    record.announce(announced(9))
    record.announce(announced(3))
    assert record.status(set(), 0.0).newest == 9
    record.announce(announced(0, "next"))
    assert record.status(set(), 0.0).newest == 0


@pytest.mark.parametrize(
    ("alive", "channels", "absent"),
    [
        (WHOLE, 2, []),
        (WHOLE, 3, ["channel 2"]),
        (WHOLE[1:], 2, ["featurizer"]),
        ([WHOLE[0], *WHOLE[2:]], None, ["fuser"]),
        ([], None, ["featurizer", "fuser", "channel"]),
        ([*WHOLE[:2], "channel/0.0of2-a", "channel/0.1of2-b"], 1, []),
        ([*WHOLE[:2], "channel/0.1of3-a"], 1, ["channel 0, shard 0/3", "channel 0, shard 2/3"]),
        # Two cuts at once, as where one is being replaced by another.
        ([*WHOLE[:2], "channel/0.0of4-a", "channel/0.0of2-b"], 1, ["channel 0, shard 1/2"]),
        ([*WHOLE[:2], "channel/0.0of2-a", "channel/0-b"], 1, []),
        # A replica makes up for nothing else.
        ([*WHOLE[:2], "channel/0.0of2-a", "channel/0.0of2-b"], 1, ["channel 0, shard 1/2"]),
        ([*WHOLE, "channel/nonsense"], 2, []),
    ],
)
def test_what_is_missing_for_whole_answers_is_named(
    alive: list[str], channels: int | None, absent: list[str]
) -> None:
    pairs = [(service, name) for service, _, name in (each.partition("/") for each in alive)]
    assert missing(pairs, channels) == absent


def test_other_runs_are_named_in_the_order_of_their_numbers_where_this_one_is_not_there() -> None:
    runs = {"car-10", "car-2", "car-1"}
    assert other_runs("cars", runs) == "there is car-1, car-2, car-10: name one with --run"
    assert other_runs("car-2", runs) is None
    assert other_runs("car-2", set()) is None


def test_counts_are_shown_by_name_and_those_that_are_too_fast_in_words() -> None:
    counts = {"received": 70, "too_fast": 12, "matches": 60}
    assert counts_in_words(counts) == (
        "matches 60, received 70, 12 frames faster than the map resolves"
    )
    assert counts_in_words({"too_fast": 1}) == "1 frame faster than the map resolves"
    assert counts_in_words({}) == ""


def test_counts_of_what_is_no_fault_are_named_as_such() -> None:
    counts = {"received": 70, "late": 6, "duplicate": 8}
    assert counts_in_words(counts) == (
        "received 70; sent twice or late, no fault: duplicate 8, late 6"
    )
    assert counts_in_words({"late": 1}) == "sent twice or late, no fault: late 1"


def test_a_service_with_another_map_than_the_fuser_is_missing(record: RunRecord) -> None:
    maps = {"fuser/u1": "a", "channel/c1": "b", "channel/old": "c"}
    for name, of in maps.items():
        service, process = name.split("/")
        own = stats(service, 1, channels=2).model_copy(update={"map": of * 16})
        record.update(service, process, own, 5.0)
    status = record.status(tokens(*WHOLE), 6.0)  # the old worker is dead
    assert status.missing == (f"channel c1 on map {'a' * 16}: it has {'b' * 16}",)
    found = {each.name: each.map for each in status.services}
    assert found == {
        "channel 0": "b" * 16,
        "channel 1": "b" * 16,
        "featurizer": None,
        "fuser": "a" * 16,
    }


def test_a_shard_is_named_with_its_channel(record: RunRecord) -> None:
    [shard] = record.status(tokens("channel/2.0of4-c1"), 6.0).services
    assert shard.name == "channel 2, shard 0/4"
