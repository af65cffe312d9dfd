import pytest

from placefield_tools.dashboard.missing_services import can_answer, missing_in_words
from placefield_tools.status.service_status import RunStatus


def missing_only(*missing: str) -> RunStatus:
    return RunStatus(None, None, None, (), missing)


def test_missing_services_are_named() -> None:
    assert missing_in_words(missing_only()) == ""
    assert missing_in_words(missing_only("fuser", "channel 2")) == "missing: fuser; channel 2"


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
    assert can_answer(missing_only(*missing)) == answers
