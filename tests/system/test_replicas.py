"""Two workers serve the same channels: one of them may die without effect."""

from pathlib import Path

from hosting import Host, Process, answers_of, offline, smoothed_of, smoothed_offline, wait_until

from placefield.maps.map import Map

CHANNELS = ("--channel", "0", "--channel", "1", "--channel", "2")
BEFORE = 15


def test_while_one_of_two_replicas_is_killed_no_answer_is_flagged_or_another(
    tmp_path: Path, map_path: Path, route_map: Map, query_dir: Path
) -> None:
    expected = offline(route_map, sorted(query_dir.iterdir()))
    with Host(tmp_path, map_path, "--workers", "1") as host, host.listener() as listener:
        at = ("--endpoint", host.endpoint)
        with (
            Process(tmp_path, "channel", map_path, *CHANNELS, *at),
            Process(tmp_path, "replay", query_dir, "--rate", "12", *at) as replay,
        ):
            with replay.paused():
                wait_until(lambda: len(listener.alive("channel")) == 6, "the replica is there")
            answers = listener.answers(count=BEFORE)
            (worker,) = host.service("channel")
            worker.kill()
            answers += listener.answers(first=BEFORE)
        assert answers_of(answers) == expected
        smoothed = smoothed_of(listener.smoothed(answers[0][0].stream))
        assert smoothed == smoothed_offline(route_map, sorted(query_dir.iterdir()))
        second = listener.count("fuser", "duplicate") + listener.count("fuser", "late")
        assert second > 0
