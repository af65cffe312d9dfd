import os
import signal
import sys
from pathlib import Path

import psutil
import pytest
from hosting import (
    PATIENCE_S,
    Host,
    Process,
    answers_of,
    command_line,
    free_endpoint,
    is_alive,
    offline,
    wait_until,
)

from placefield.maps.map import Map


def test_a_host_says_once_that_it_is_ready_and_runs_the_services(host: Host) -> None:
    assert host.out.count("\n") == 1
    assert host.out.startswith(f"ready: run 'default' at {host.endpoint}, 3 channels")
    for service, count in (("featurizer", 1), ("channel", 2), ("fuser", 1), ("serve", 1)):
        assert len(host.service(service)) == count
    assert len(host.children()) == 5


def test_a_signal_stops_all_in_order_and_none_has_to_be_killed(logs: Path, map_path: Path) -> None:
    with Host(logs, map_path) as own:
        assert own.stop(signal.SIGINT) == 0
        assert not own.left_behind()
        assert not own.err


def test_so_it_does_in_mid_stream(logs: Path, map_path: Path, query_dir: Path) -> None:
    with Host(logs, map_path, "--workers", "8") as own, own.listener() as listener:
        assert len(own.service("channel")) == 3  # as many as there are channels
        with Process(logs, "replay", query_dir, "--loop", "--endpoint", own.endpoint) as replay:
            listener.answers(count=5)
            assert own.stop(signal.SIGTERM) == 0
            assert not own.left_behind()
            assert "killing" not in own.err
            assert replay.stop(signal.SIGTERM) == 0


def test_a_host_that_is_stopped_while_it_starts_leaves_nothing(logs: Path, map_path: Path) -> None:
    with Process(logs, "up", map_path, "--endpoint", free_endpoint()) as starting:
        wait_until(starting.children, "a service is started")
        assert starting.stop(signal.SIGTERM) == 0
        assert not starting.left_behind()


def test_the_services_of_a_host_that_was_killed_end_by_themselves(
    logs: Path, map_path: Path
) -> None:
    with Host(logs, map_path) as own:
        started = psutil.Process(own.pid).children(recursive=True)
        assert own.stop(signal.SIGKILL) == -signal.SIGKILL
        _, alive = psutil.wait_procs(started, timeout=PATIENCE_S)
        assert not alive


def test_a_service_has_its_own_command_line_and_session(host: Host, map_path: Path) -> None:
    (fuser,) = host.service("fuser")
    assert command_line(fuser).startswith(
        f"{sys.executable} -m placefield_tools fuser {map_path} --config "
    )
    started = [host.forkserver(), *host.children()]
    sessions = {os.getsid(pid) for pid in (host.pid, *(process.pid for process in started))}
    assert len(sessions) == 1 + len(started)


def test_a_forkserver_that_was_killed_is_started_again_with_all_services(
    logs: Path, map_path: Path, query_dir: Path, route_map: Map
) -> None:
    with Host(logs, map_path) as own, own.listener() as listener:
        services, forkserver, tokens = own.children(), own.forkserver(), listener.alive("*")
        assert forkserver.num_threads() == 1
        for service in services:
            service.suspend()  # so that none can end by itself
        forkserver.kill()
        wait_until(lambda: not any(map(is_alive, services)), "none lives on")
        wait_until(lambda: len(listener.alive("*") - tokens) == len(tokens), "all are back")
        assert len(own.children()) == len(services)
        own.replay(query_dir)
        assert answers_of(listener.answers()) == offline(route_map, sorted(query_dir.iterdir()))
        assert own.err.count("was lost, as the forkserver was killed; starting it again") == len(
            services
        )


def test_a_host_that_is_killed_while_the_forkserver_starts_leaves_nothing(
    logs: Path, map_path: Path
) -> None:
    with Process(logs, "up", map_path, "--endpoint", free_endpoint()) as starting:
        host = psutil.Process(starting.pid)
        wait_until(lambda: len(host.children()) == 2, "the forkserver is started")
        started = host.children()
        assert starting.stop(signal.SIGKILL) == -signal.SIGKILL
        wait_until(lambda: not any(map(is_alive, started)), "all have ended")


@pytest.mark.parametrize(
    ("service", "flag"), [("featurizer", ""), ("channel", "--channel 1"), ("fuser", "")]
)
def test_a_service_that_was_killed_is_started_again_and_works(
    host: Host, route_map: Map, query_dir: Path, service: str, flag: str
) -> None:
    with host.listener() as listener:
        tokens = listener.alive(service)
        (victim,) = host.service(service, flag)
        victim.kill()
        wait_until(lambda: listener.alive(service) < tokens, "it is gone")
        wait_until(lambda: len(listener.alive(service)) == len(tokens), "it is back")
        assert [process.pid for process in host.service(service, flag)] != [victim.pid]
        host.replay(query_dir)
        assert answers_of(listener.answers()) == offline(route_map, sorted(query_dir.iterdir()))
    assert "was ended by SIGKILL; starting it again" in host.err
