import pytest

from placefield.bus.keys import Keys, Part, part_of, run_of, service_and_identity


def test_no_two_keys_of_one_run_or_of_two_runs_are_one() -> None:
    keys = []
    for run in (Keys("one"), Keys("two")):
        keys += [run.frame, run.feature, run.match, run.ack]
        keys += [run.candidates("a"), run.candidates("b")]
        keys += [run.alive("fuser", "a"), run.stats("fuser", "a"), run.stats("featurizer", "a")]
    assert len(set(keys)) == len(keys)


def test_service_and_identity_are_read_back_from_a_key() -> None:
    keys = Keys("default")
    assert service_and_identity(keys.alive("channel", "3-ab12")) == ("channel", "3-ab12")
    assert service_and_identity(keys.stats("fuser", "cd34")) == ("fuser", "cd34")


def test_the_run_is_read_back_from_a_key() -> None:
    keys = Keys("night")
    for key in (keys.frame, keys.candidates("a"), keys.match, keys.alive("fuser", "a")):
        assert run_of(key) == "night"


@pytest.mark.parametrize("part", [Part(0), Part(63), Part(7, 0, 4), Part(7, 3, 4)])
def test_the_part_is_read_back_from_the_name_of_its_token(part: Part) -> None:
    assert part_of(part.identity("ab12")) == part


@pytest.mark.parametrize(
    "name",
    ["", "-", "ab12", "x-ab12", "-1-ab12", "²-ab12", "*", "1.4of4-a", "1.0of-a", "1.-a", "9" * 99],
)
def test_a_malformed_name_has_no_part(name: str) -> None:
    assert part_of(name) is None
