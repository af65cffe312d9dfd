import threading

from placefield.bus.keys import Keys, Part
from placefield_services.live_channels import LiveChannels

KEYS = Keys("test")


def test_a_channel_is_alive_as_long_as_one_of_its_workers() -> None:
    channels = LiveChannels(2)
    for worker in ("one", "two"):
        channels.change(KEYS.alive("channel", Part(1).identity(worker)), True)
    channels.change(KEYS.alive("channel", Part(1).identity("one")), False)
    assert channels.alive == {1}
    channels.change(KEYS.alive("channel", Part(1).identity("two")), False)
    channels.change(KEYS.alive("channel", "nameless"), True)
    assert not channels.alive


def test_waiting_for_all_channels_ends_with_the_last_or_with_the_time_or_when_stopped() -> None:
    channels, stop = LiveChannels(2), threading.Event()
    channels.change(KEYS.alive("channel", Part(0).identity("worker")), True)
    channels.wait_for_all(0.05, stop.is_set)
    last = KEYS.alive("channel", Part(1).identity("worker"))
    timer = threading.Timer(0.05, channels.change, [last, True])
    timer.start()
    channels.wait_for_all(60, stop.is_set)
    timer.join()
    assert channels.alive == {0, 1}
    channels.change(last, False)
    stop.set()
    channels.wait_for_all(60, stop.is_set)


def test_a_channel_in_shards_is_alive_once_all_of_them_are() -> None:
    channels = LiveChannels(1)
    tokens = [KEYS.alive("channel", Part(0, shard, 3).identity("a")) for shard in range(3)]
    for token in tokens:
        assert channels.alive == frozenset()
        channels.change(token, True)
    assert channels.alive == {0}
    channels.change(KEYS.alive("channel", Part(0, 1, 3).identity("replica")), True)
    channels.change(tokens[1], False)
    assert channels.alive == {0}
    channels.change(tokens[0], False)
    assert channels.alive == frozenset()
    channels.change(KEYS.alive("channel", Part(0).identity("whole")), True)
    assert channels.alive == {0}
