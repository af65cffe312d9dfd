import pytest

from placefield_tools.dashboard.missing_services import (
    can_answer,
    slowest_in_words,
)
from placefield_tools.status.service_status import RunStatus, ServiceStatus


def missing_only(*missing: str) -> RunStatus:
    return RunStatus(None, None, None, (), missing)


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


def test_the_slowest_service_is_named() -> None:
    def service(name: str, behind: int | None) -> ServiceStatus:
        return ServiceStatus(name, "a", None, "s", 9, behind, 2.0, False, {})

    services = (service("featurizer", 1), service("fuser", 7), service("channel", None))
    status = RunStatus("s", 9, 4, services, ())
    assert slowest_in_words(status) == "; the slowest is fuser, 7 frames (3.5 s) behind"
    for behind in (0, 1):  # a frame under way
        assert slowest_in_words(RunStatus("s", 9, 4, (service("fuser", behind),), ())) == ""
