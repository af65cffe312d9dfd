import pytest

from placefield_tools.dashboard.missing_services import (
    can_answer,
    missing_in_words,
    slowest_in_words,
)
from placefield_tools.status.service_status import RunStatus, ServiceStatus


def missing_only(*missing: str) -> RunStatus:
    return RunStatus(None, None, None, (), missing)


def test_missing_and_silent_services_are_named() -> None:
    assert missing_in_words(missing_only()) == ""
    assert missing_in_words(missing_only("fuser", "channel 2")) == "missing: fuser; channel 2"
    hanging = ServiceStatus("channel", "a", None, None, None, None, None, True, {"received": 1})
    status = RunStatus(None, None, None, (hanging,), ("fuser",))
    assert missing_in_words(status) == "missing: fuser · silent: channel"


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
