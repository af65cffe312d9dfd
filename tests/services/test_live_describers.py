import random
from collections import Counter

from placefield.bus.keys import Keys
from placefield.bus.session import MOST_TOKENS
from placefield_services.live_describers import LiveDescribers

KEYS = Keys("test")


def token(identity: str) -> str:
    return KEYS.alive("describer", identity)


def describers(*identities: str) -> LiveDescribers:
    live = LiveDescribers()
    for identity in identities:
        live.change(token(identity), True)
    return live


def test_all_processes_give_a_frame_to_the_same_describer_in_whatever_order_tokens_come() -> None:
    names = ["ab12", "00ff", "9c9c", "e5e5"]
    one = describers(*names)
    random.Random(1).shuffle(names)
    other = describers("dead", *names, names[0])
    other.change(token("dead"), False)
    other.change(token("never"), False)
    assert [one.whose(n, 0) for n in range(50)] == [other.whose(n, 0) for n in range(50)]


def test_describers_and_featurizer_have_equal_shares() -> None:
    live = describers("a", "b")
    for part in range(3):
        shares = Counter(live.whose(sequence, part) for sequence in range(300))
        assert shares == {"a": 100, "b": 100, None: 100}


def test_the_parts_of_a_frame_are_described_at_the_same_time() -> None:
    live = describers("a", "b")
    for sequence in range(9):
        assert {live.whose(sequence, part) for part in range(3)} == {"a", "b", None}


def test_a_part_falls_to_the_describers_that_are_bound_to_it_and_to_no_other() -> None:
    live = describers("a", "1-b", "1-c", "2-d")
    assert [live.whose(n, 0) for n in range(4)] == ["a", None, "a", None]
    assert [live.whose(n, 1) for n in range(4)] == ["c", "b", "c", "b"]
    assert [live.whose(n, 2) for n in range(2)] == ["d", "d"]
    assert live.workers == {"a", "b", "c", "d"}
    for identity in ("1-b", "1-c"):
        live.change(token(identity), False)
    assert [live.whose(n, 1) for n in range(3)] == [None, "a", None]


def test_without_describers_the_featurizer_describes_every_frame() -> None:
    live = describers("a")
    live.change(token("a"), False)
    assert {live.whose(sequence, 0) for sequence in range(9)} == {None}


def test_no_more_tokens_are_kept_than_a_run_may_have() -> None:
    live = describers(*(f"{number:x}" for number in range(MOST_TOKENS + 9)))
    assert len(live.workers) == MOST_TOKENS
