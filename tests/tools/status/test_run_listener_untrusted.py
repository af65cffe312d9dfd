"""Thousands of tokens and counts of untrusted clients do not hide the services."""

from collections.abc import Callable
from typing import Any

import pytest

from placefield.bus.keys import Keys, Part
from placefield.bus.messages import StatsMessage
from placefield.bus.session import LONGEST_STATS, MOST_TOKENS, Bus
from placefield.errors import MessageError
from placefield_services.live_channels import LiveChannels
from placefield_tools.status.statistics import RunListener

KEYS = Keys("test")


class FakeBus(Bus):
    """Calls the listeners with the messages of a test."""

    def __init__(self) -> None:
        self.stats: Callable[[str, bytes], None] = lambda key, payload: None
        self.life: Callable[[str, bool], None] = lambda key, is_alive: None

    def subscribe_raw(self, key: str, receive: Callable[[str, bytes], None]) -> Any:
        self.stats = receive

    def watch_alive(self, key: str, change: Callable[[str, bool], None]) -> Any:
        self.life = change


@pytest.fixture
def bus() -> FakeBus:
    return FakeBus()


@pytest.fixture
def malformed() -> list[str]:
    return []


@pytest.fixture
def listener(bus: FakeBus, malformed: list[str]) -> RunListener:
    def note(key: str, error: MessageError) -> None:
        malformed.append(key)

    return RunListener(bus, KEYS, note)


def counts(service: str, **counts: int) -> bytes:
    return StatsMessage(service=service, counts=counts).encode()


def test_counts_belong_to_a_token_and_go_with_it(bus: FakeBus, listener: RunListener) -> None:
    token, key = KEYS.alive("channel", "2-ab"), KEYS.stats("channel", "ab")
    for number in (7, 8):
        bus.life(token, True)
        bus.stats(key, counts("channel", received=number))
        assert [each.counts for each in listener.status().services] == [{"received": number}]
        bus.life(token, False)
        assert not listener.status().services
        bus.life(token, True)
        assert [each.counts for each in listener.status().services] == [{}]
        bus.life(token, False)


def test_counts_of_thousands_without_a_token_are_left_out_and_counted(
    bus: FakeBus, listener: RunListener
) -> None:
    bus.life(KEYS.alive("fuser", "own"), True)
    for _ in range(2):
        for number in range(2 * MOST_TOKENS):
            bus.stats(KEYS.stats("fuser", f"x{number}"), counts("fuser", matches=1))
    bus.stats(KEYS.stats("fuser", "own"), counts("fuser", matches=9))
    [fuser] = listener.status().services
    assert fuser.counts == {"matches": 9}
    assert MOST_TOKENS <= listener.left_out <= 2 * MOST_TOKENS


def test_a_report_before_its_token_counts_as_a_service(bus: FakeBus, listener: RunListener) -> None:
    bus.stats(KEYS.stats("fuser", "own"), counts("fuser", matches=9))
    bus.life(KEYS.alive("fuser", "own"), True)
    assert listener.left_out == 0


def test_tokens_over_the_limit_are_left_out_and_counted(
    bus: FakeBus, listener: RunListener
) -> None:
    bus.life(KEYS.alive("fuser", "own"), True)
    for number in range(MOST_TOKENS + 50):
        bus.life(KEYS.alive("channel", f"{number}-x"), True)
    status = listener.status()
    assert len(status.services) == MOST_TOKENS
    assert listener.left_out == 51
    assert "fuser" not in status.missing


def test_counts_that_are_too_long_are_malformed(
    bus: FakeBus, listener: RunListener, malformed: list[str]
) -> None:
    bus.life(KEYS.alive("fuser", "own"), True)
    many = {f"n{number}": 1 for number in range(LONGEST_STATS // 4)}
    bus.stats(KEYS.stats("fuser", "own"), counts("fuser", **many))
    assert malformed == [KEYS.stats("fuser", "own")]
    assert listener.status().services[0].counts == {}


def test_a_cut_into_very_many_shards_is_reported_in_short(
    bus: FakeBus, listener: RunListener
) -> None:
    bus.life(KEYS.alive("channel", "0.1of99999-x"), True)
    missing = listener.status().missing
    assert len(missing) < 200
    assert missing[-1].endswith(" more")


def test_thousands_of_tokens_of_other_channels_make_no_channel_alive_or_dead() -> None:
    channels = LiveChannels(2)
    own = [KEYS.alive("channel", Part(number).identity("own")) for number in range(2)]
    for token in own:
        channels.change(token, True)
    for is_alive in (True, False):
        for number in range(2, 3 * MOST_TOKENS):
            channels.change(KEYS.alive("channel", f"{number}-x"), is_alive)
        for number in range(3 * MOST_TOKENS):
            channels.change(KEYS.alive("channel", f"1.0of9-x{number}"), is_alive)
        assert channels.alive == {0, 1}
    channels.change(own[1], False)
    assert channels.alive == {0}
