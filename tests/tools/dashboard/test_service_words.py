import pytest

from placefield_tools.dashboard.service_words import (
    can_answer,
    slowest_in_words,
    state_in_words,
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


def service(
    name: str = "fuser", behind: int | None = None, *, silent: bool = False, **counts: int
) -> ServiceStatus:
    return ServiceStatus(name, "a", None, "s", 9, behind, 2.0, silent, counts)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (service(), "running"),
        (service(behind=1, received=3), "running"),  # a frame under way
        (service(behind=7), "7 frames (3.5 s) behind"),
        (service(behind=7, gaps=1), "7 frames (3.5 s) behind, 1 frame missed"),
        (service(behind=0, gaps=4), "running, 4 frames missed"),
        (service("verifier", behind=20), "running"),  # as many as smoothing takes
        (service(silent=True), "starting"),
        (service(silent=True, received=3), "silent"),
    ],
)
def test_the_state_of_a_service_is_said_in_words(given: ServiceStatus, words: str) -> None:
    assert state_in_words(given) == words


def test_the_slowest_service_is_named() -> None:
    services = (service("featurizer", 1), service("fuser", 7), service("channel", None))
    status = RunStatus("s", 9, 4, services, ())
    assert slowest_in_words(status) == "fuser, 7 frames (3.5 s) behind"
    for behind in (0, 1):  # a frame under way
        assert slowest_in_words(RunStatus("s", 9, 4, (service("fuser", behind),), ())) == ""
