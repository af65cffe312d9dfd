from pathlib import Path

import psutil
from hosting import wait_until

from placefield.config import BusConfig
from placefield_tools.dashboard.replay_process import ReplayChild, replay_flags


def test_a_replay_that_fails_says_why_in_one_line(endpoint: str, tmp_path: Path) -> None:
    replay = ReplayChild(replay_flags("default", BusConfig(endpoint=endpoint)))
    assert replay.status == "no replay was started here"
    assert not replay.has_failed
    source = tmp_path / "--help"  # no flag, whatever it is called
    replay.start(str(source), None, "", loop=False)
    assert replay.status == f"replaying {source}"
    wait_until(lambda: not replay.status.startswith("replaying"), "the replay has failed")
    assert str(source) in replay.status
    assert replay.has_failed
    assert "\n" not in replay.status
    replay.close()
    assert replay.status == "no replay was started here"


def test_a_replay_has_the_calibration_of_the_camera(
    endpoint: str, reference_dir: Path, tmp_path: Path
) -> None:
    replay = ReplayChild(replay_flags("default", BusConfig(endpoint=endpoint)))
    camera = tmp_path / "no.yaml"
    replay.start(str(reference_dir), None, str(camera), loop=False)
    wait_until(lambda: not replay.status.startswith("replaying"), "the replay has failed")
    assert replay.status == f"{camera}: cannot be read: No such file or directory"
    replay.close()


def test_a_replay_is_ended_with_the_dashboard(endpoint: str, reference_dir: Path) -> None:
    replay = ReplayChild(replay_flags("default", BusConfig(endpoint=endpoint)))
    others = set(psutil.Process().children())
    replay.start(str(reference_dir), 5, "", loop=True)  # waits for a router
    [child] = set(psutil.Process().children()) - others
    replay.start("another", None, "", loop=False)  # while one is on
    assert set(psutil.Process().children()) - others == {child}
    replay.close()
    assert not child.is_running()


def test_a_replay_has_a_cameras_credentials() -> None:
    bus = BusConfig(endpoint="tls/host:1", credentials="/etc/roles/dashboard")
    flags = replay_flags("day", bus)
    assert flags == [
        "--run",
        "day",
        "--endpoint",
        "tls/host:1",
        "--credentials",
        "/etc/roles/camera",
    ]
