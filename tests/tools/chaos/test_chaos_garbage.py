from collections import Counter

import pytest

from placefield.bus.inbox import Received
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, StatsMessage
from placefield.errors import MessageError
from placefield_tools.chaos.garbage import SPOILERS, messages

HEADER = Header(stream="received", sequence=3, stamp_ns=7)
RECEIVED = {
    "placefield/default/frame": [
        Received("placefield/default/frame", HEADER, FrameMessage(image=b"image").encode())
    ],
    "placefield/default/stats/x/1": [
        Received(
            "placefield/default/stats/x/1", HEADER, StatsMessage(service="x", counts={}).encode()
        )
    ],
    "placefield/default/end": [Received("placefield/default/end", HEADER, b"")],
}


def is_read(header: bytes, payload: bytes) -> bool:
    try:
        Header.decode(header)
        FrameMessage.decode(payload)
    except MessageError:
        return False
    return True


@pytest.mark.parametrize("sort", SPOILERS)
def test_messages_of_a_sort_are_the_same_for_the_same_seed_and_go_to_every_topic(sort: str) -> None:
    made = list(messages(RECEIVED, sort, 60, seed=1))
    assert made == list(messages(RECEIVED, sort, 60, seed=1))
    assert Counter(key for key, _ in made) == dict.fromkeys(RECEIVED, 20)


@pytest.mark.parametrize("sort", ["another version", "large"])
def test_messages_of_a_sort_that_no_service_may_accept_are_refused(sort: str) -> None:
    made = messages({"frame": RECEIVED["placefield/default/frame"]}, sort, 60, seed=1)
    assert not any(is_read(*message) for _, message in made)


@pytest.mark.parametrize("sort", ["replayed", "out of order", "the future", "many streams"])
def test_messages_that_come_at_a_bad_time_are_good_ones(sort: str) -> None:
    made = messages({"frame": RECEIVED["placefield/default/frame"]}, sort, 60, seed=1)
    assert all(is_read(*message) for _, message in made)
