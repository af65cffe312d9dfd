"""A host whose clock is an hour off, at the other end of a slow link that loses packets."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from hosting import (
    PATIENCE_S,
    Listener,
    Process,
    answers_of,
    environment,
    offline,
    placefield,
    wait_until,
)
from slow_links import SlowLink

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
from placefield.maps.map import Map
from placefield_tools.common.host_process import free_endpoint

_FAST_CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>
static int is_of_day(clockid_t id) { return id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE; }
int clock_gettime(clockid_t id, struct timespec *now) {
    static int (*ask)(clockid_t, struct timespec *);
    if (!ask) ask = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int failed = ask(id, now);
    if (!failed && is_of_day(id)) now->tv_sec += 3600;
    return failed;
}
int gettimeofday(struct timeval *now, void *zone) {
    struct timespec exact;
    (void)zone;
    if (clock_gettime(CLOCK_REALTIME, &exact)) return -1;
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *out) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (out) *out = now.tv_sec;
    return now.tv_sec;
}
"""

PATIENT = ("--set", f"bus.connect_timeout_s={PATIENCE_S:g}")


@dataclass
class Hosts:
    """The near host, and the link to the far host, whose clock is fast."""

    endpoint: str
    link: SlowLink


@pytest.fixture(scope="module")
def fast_clock_library(logs: Path) -> Path:
    """A library that makes the clock of a process an hour fast."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("to change the clock of a process needs a C compiler, cc")
    source, library = logs / "fast_clock.c", logs / "fast_clock.so"
    source.write_text(_FAST_CLOCK)
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


@pytest.fixture(scope="module")
def hosts(logs: Path, map_path: Path, fast_clock_library: Path) -> Iterator[Hosts]:
    """Featurizer and a channel are far, the source, the other channels and the fuser near."""
    near, linked, far = free_endpoint(), free_endpoint(), free_endpoint()
    with ExitStack() as stack:
        link = stack.enter_context(SlowLink(_port(linked), _port(near)))
        stack.enter_context(Process(logs, "router", "--endpoint", near))
        for service in (["fuser"], ["channel", "--channel", "0", "--channel", "1"]):
            stack.enter_context(Process(logs, *service, map_path, "--endpoint", near, *PATIENT))
        router = ("router", "--endpoint", far, "--connect", linked)
        fast_clock = environment(LD_PRELOAD=str(fast_clock_library))
        stack.enter_context(Process(logs, *router, env=fast_clock))
        for service in (["featurizer"], ["channel", "--channel", "2"]):
            command = (*service, map_path, "--endpoint", far, *PATIENT)
            stack.enter_context(Process(logs, *command, env=fast_clock))
        bus = stack.enter_context(open_bus(BusConfig(endpoint=near, connect_timeout_s=PATIENCE_S)))
        listener = Listener(bus)
        wait_until(lambda: listener.alive("fuser"), "the fuser is ready")
        wait_until(lambda: listener.alive("featurizer"), "the featurizer is ready")
        yield Hosts(near, link)


@pytest.fixture
def listener(hosts: Hosts) -> Iterator[Listener]:
    with open_bus(BusConfig(endpoint=hosts.endpoint)) as bus:
        yield Listener(bus)


def _port(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


def test_nothing_depends_on_the_clock_of_a_host(
    hosts: Hosts, listener: Listener, route_map: Map, query_dir: Path, fast_clock_library: Path
) -> None:
    show = ["python3", "-c", "import time; print(int(time.time()))"]
    fast_clock = environment(LD_PRELOAD=str(fast_clock_library))
    now, then = (
        int(subprocess.run(show, env=env, capture_output=True, text=True, check=True).stdout)
        for env in (environment(), fast_clock)
    )
    assert 3600 <= then - now < 3660
    replayed = placefield("replay", query_dir, "--endpoint", hosts.endpoint)
    assert replayed.returncode == 0, replayed.stderr
    answers = listener.answers()
    assert answers_of(answers) == offline(route_map, sorted(query_dir.iterdir()))


def test_a_slow_link_that_loses_packets_costs_no_frame_and_makes_no_answer_wrong(
    hosts: Hosts, listener: Listener, route_map: Map, query_dir: Path
) -> None:
    undisturbed = offline(route_map, sorted(query_dir.iterdir()))
    hosts.link.delay_s, hosts.link.loss = 0.2, 0.05
    try:
        replayed = placefield("replay", query_dir, "--endpoint", hosts.endpoint, "--rate", "20")
        assert replayed.returncode == 0, replayed.stderr
        answers = answers_of(listener.answers())
    finally:
        hosts.link.delay_s, hosts.link.loss = 0.0, 0.0
    assert hosts.link.lost
    assert len(answers) == len(undisturbed)
    whole = [number for number, (_, _, missing) in enumerate(answers) if not missing]
    assert [answers[number] for number in whole] == [undisturbed[number] for number in whole]
    assert len(whole) > len(answers) / 2
