import pytest

from placefield.bus.keys import Keys, channel_identity, channel_of, run_of, service_and_identity


def test_no_two_keys_of_one_run_or_of_two_runs_are_one() -> None:
    keys = []
    for run in (Keys("one"), Keys("two")):
        keys += [run.frame, run.feature, run.match, run.ack]
        keys += [run.candidate(0), run.candidate(1), run.candidate(0, shard=1)]
        keys += [run.alive("fuser", "a"), run.stats("fuser", "a"), run.stats("featurizer", "a")]
    assert len(set(keys)) == len(keys)


def test_service_and_identity_come_back_out_of_a_key() -> None:
    keys = Keys("default")
    assert service_and_identity(keys.alive("channel", "3-ab12")) == ("channel", "3-ab12")
    assert service_and_identity(keys.stats("fuser", "cd34")) == ("fuser", "cd34")


def test_the_run_comes_back_out_of_a_key() -> None:
    keys = Keys("night")
    for key in (keys.frame, keys.candidate(3), keys.match, keys.alive("fuser", "a")):
        assert run_of(key) == "night"


@pytest.mark.parametrize("channel", [0, 7, 63])
def test_the_channel_comes_back_out_of_a_workers_name(channel: int) -> None:
    assert channel_of(channel_identity(channel, "ab12")) == channel


@pytest.mark.parametrize("name", ["", "-", "ab12", "x-ab12", "-1-ab12", "²-ab12", "*"])
def test_a_name_without_a_channel_has_none(name: str) -> None:
    assert channel_of(name) is None
