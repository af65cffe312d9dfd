import pytest

from placefield.bus.keys import Keys, Part
from placefield.bus.message import Header
from placefield.bus.messages import StatsMessage
from placefield_tools.status.service_status import (
    SILENT_S,
    RunRecord,
    RunStanding,
    ServiceStanding,
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


def told(
    service: str, sequence: int | None, stream: str | None = "s", channels: int | None = None
) -> StatsMessage:
    return StatsMessage(
        service=service,
        counts={"received": 9},
        stream=None if sequence is None else stream,
        sequence=sequence,
        channels=channels,
    )


def service_of(standing: RunStanding, identity: str) -> ServiceStanding:
    [found] = [service for service in standing.services if service.identity == identity]
    return found


@pytest.fixture
def record() -> RunRecord:
    return RunRecord()


def test_a_service_is_behind_by_what_had_been_announced_when_it_told(record: RunRecord) -> None:
    record.announce(announced(30))
    record.tell("channel", "c1", told("channel", 27), 5.0)
    record.announce(announced(55))  # until it tells again
    record.tell("fuser", "u1", told("fuser", 55, channels=2), 5.9)
    standing = record.standing(tokens(*WHOLE), 6.0)
    assert (standing.stream, standing.newest, standing.channels) == ("s", 55, 2)
    for identity in ("0-c1", "1-c1"):
        assert service_of(standing, identity).behind == 3
        assert service_of(standing, identity).sequence == 27
    assert service_of(standing, "u1").behind == 0
    assert service_of(standing, "0-c1").part == Part(0)
    assert not standing.missing


def test_one_that_has_fallen_silent_is_behind_by_all_that_came_since(record: RunRecord) -> None:
    record.announce(announced(30))
    record.tell("channel", "c1", told("channel", 30), 5.0)
    record.announce(announced(130))
    heard = service_of(record.standing(tokens("channel/0-c1"), 5.0 + SILENT_S), "0-c1")
    silent = service_of(record.standing(tokens("channel/0-c1"), 5.1 + SILENT_S), "0-c1")
    assert (heard.silent, heard.behind) == (False, 0)
    assert (silent.silent, silent.behind) == (True, 100)


def test_a_service_that_has_told_nothing_is_silent_and_a_replay_need_not_tell(
    record: RunRecord,
) -> None:
    standing = record.standing(tokens("fuser/u1", "replay/r1"), 1.0)
    assert [service.silent for service in standing.services] == [True, False]
    assert all(service.behind is None for service in standing.services)


def test_in_a_stream_that_rests_services_are_behind_the_one_that_is_furthest(
    record: RunRecord,
) -> None:
    record.tell("channel", "c1", told("channel", 4, "old"), 5.0)
    record.tell("featurizer", "f1", told("featurizer", 8, "new"), 5.1)
    record.tell("fuser", "u1", told("fuser", 6, "new"), 5.2)
    standing = record.standing(tokens(*WHOLE), 6.0)
    assert (standing.stream, standing.newest) == ("new", 8)
    assert service_of(standing, "u1").behind == 2
    assert service_of(standing, "f1").behind == 0
    assert service_of(standing, "0-c1").behind is None  # it knows only the stream before


def test_the_rate_is_of_the_frames_between_two_tellings_of_one_stream(record: RunRecord) -> None:
    def rate() -> float | None:
        return service_of(record.standing(tokens("fuser/u1"), 5.0), "u1").rate

    rates = []
    for now, sequence, stream in ((1.0, 10, "s"), (3.0, 60, "s"), (4.0, 3, "t"), (4.5, 13, "t")):
        record.tell("fuser", "u1", told("fuser", sequence, stream), now)
        rates.append(rate())
    assert rates == [None, 25.0, None, 20.0]


def test_a_frame_announced_again_makes_none_newer(record: RunRecord) -> None:
    record.announce(announced(9))
    record.announce(announced(3))
    assert record.standing(set(), 0.0).newest == 9
    record.announce(announced(0, "next"))
    assert record.standing(set(), 0.0).newest == 0


@pytest.mark.parametrize(
    ("alive", "channels", "lacking"),
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
    alive: list[str], channels: int | None, lacking: list[str]
) -> None:
    pairs = [(service, name) for service, _, name in (each.partition("/") for each in alive)]
    assert missing(pairs, channels) == lacking


def test_other_runs_are_named_in_the_order_of_their_numbers_where_this_one_is_not_there() -> None:
    runs = {"car-10", "car-2", "car-1"}
    assert other_runs("cars", runs) == "there is car-1, car-2, car-10: name one with --run"
    assert other_runs("car-2", runs) is None
    assert other_runs("car-2", set()) is None


def test_counts_are_told_by_name_and_those_that_are_too_fast_in_words() -> None:
    counts = {"received": 70, "too_fast": 12, "matches": 60}
    assert counts_in_words(counts) == (
        "matches 60, received 70, 12 frames faster than the map resolves"
    )
    assert counts_in_words({"too_fast": 1}) == "1 frame faster than the map resolves"
    assert counts_in_words({}) == ""


@pytest.mark.parametrize("digest", [None, "a" * 16, "b" * 16])
def test_a_service_with_another_map_than_the_fuser_or_the_one_that_is_shown_is_missing(
    digest: str | None,
) -> None:
    record = RunRecord(digest)
    maps = {"featurizer/f1": "a", "fuser/u1": "a", "channel/c1": "b", "channel/old": "c"}
    for name, of in maps.items():
        service, process = name.split("/")
        stats = told(service, 1, channels=2).model_copy(update={"map": of * 16})
        record.tell(service, process, stats, 5.0)
    own = digest or "a" * 16
    lacking = record.standing(tokens(*WHOLE), 6.0).missing
    assert sorted(lacking) == sorted(
        f"{name.replace('/', ' ')} on map {own}: it has {of * 16}"
        for name, of in maps.items()
        if of * 16 != own and name != "channel/old"  # that one is dead
    )
