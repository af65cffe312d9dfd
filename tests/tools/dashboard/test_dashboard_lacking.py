import pytest

from placefield_tools.dashboard.missing_services import can_answer, lacking_words
from placefield_tools.status.service_status import RunStanding


def lacking(*missing: str) -> RunStanding:
    return RunStanding(None, None, None, (), missing)


def test_what_is_missing_is_told() -> None:
    assert lacking_words(lacking()) == ""
    assert lacking_words(lacking("fuser", "channel 2")) == "missing: fuser; channel 2"


@pytest.mark.parametrize(
    ("missing", "answers"),
    [
        ((), True),
        (("channel 0", "channel 1, shard 0/2"), True),
        (("featurizer",), False),
        (("fuser", "channel"), False),
    ],
)
def test_a_run_answers_without_a_channel_but_not_without_the_others(
    missing: tuple[str, ...], answers: bool
) -> None:
    assert can_answer(lacking(*missing)) == answers
