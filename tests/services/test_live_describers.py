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
    assert [one.whose(n) for n in range(50)] == [other.whose(n) for n in range(50)]


def test_describers_and_featurizer_have_equal_shares() -> None:
    shares = Counter(describers("a", "b").whose(sequence) for sequence in range(300))
    assert shares == {"a": 100, "b": 100, None: 100}


def test_without_describers_the_featurizer_describes_every_frame() -> None:
    live = describers("a")
    live.change(token("a"), False)
    assert {live.whose(sequence) for sequence in range(9)} == {None}


def test_no_more_tokens_are_kept_than_a_run_may_have() -> None:
    live = describers(*(f"{number:x}" for number in range(MOST_TOKENS + 9)))
    assert len(live.alive) == MOST_TOKENS
