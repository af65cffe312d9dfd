"""A host starts, restarts and ends its services; here they are small scripts."""

import os
import random
import threading
from ast import literal_eval
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from host_scripts import SCRIPTS
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys, Part
from placefield.config import BusConfig, Config
from placefield.errors import BusError
from placefield_services import host
from placefield_services.forkserver import LOST
from placefield_services.host import run_host

RUNS_ON = "import time\ntime.sleep(60)"
IS_KILLED = "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)"


@pytest.fixture
def config(endpoint: str) -> Config:
    return Config(runs=("test",), bus=BusConfig(endpoint=endpoint))


def _end_forkserver() -> None:
    for child in psutil.Process().children():
        if child.name().startswith("placefield fork"):
            child.kill()


@pytest.fixture(autouse=True)
def _leaves_only_the_forkserver_behind() -> Iterator[None]:
    before = set(psutil.Process().children(recursive=True))
    yield
    started = set(psutil.Process().children(recursive=True)) - before
    services = {each for each in started if each.ppid() != os.getpid()}
    for process in services:
        process.kill()
    assert not services


def run(scripts: dict[str, str], config: Config, until: Callable[[], bool]) -> None:
    """Run Python scripts as the services of a host until a condition holds."""
    commands = {name: [script] for name, script in scripts.items()}
    stop = threading.Event()
    watch = threading.Thread(target=_stop_when, args=(until, stop))
    watch.start()
    try:
        run_host(SCRIPTS, commands, 1, config, stop, lambda: None)
    finally:
        stop.set()
        watch.join()


def _stop_when(until: Callable[[], bool], stop: threading.Event) -> None:
    for _ in range(600):
        if until() or stop.wait(0.05):
            break
    stop.set()


def appends_to(file: Path, text: str = "started") -> str:
    return f"open({str(file)!r}, 'a').write({text + chr(10)!r})\n"


def lines(file: Path) -> list[str]:
    return file.read_text().splitlines() if file.exists() else []


def test_a_service_that_dies_is_restarted(config: Config, tmp_path: Path) -> None:
    dies, stays = tmp_path / "dies", tmp_path / "stays"
    scripts = {"dies": appends_to(dies) + IS_KILLED, "stays": appends_to(stays)}
    scripts["stays"] += RUNS_ON
    run(scripts, config, lambda: len(lines(dies)) >= 3)
    assert len(lines(dies)) >= 3
    assert len(lines(stays)) == 1


def test_a_service_that_cannot_start_ends_the_host_and_is_named(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host, "_RESTART_AFTER_S", 0.0)
    scripts = {"channel worker 1": IS_KILLED, "fuser": RUNS_ON}
    with pytest.raises(BusError, match="channel worker 1 was ended by SIGKILL 5 times in a row"):
        run(scripts, config, lambda: False)


def test_several_services_that_die_too_often_end_the_host_with_one_line(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host, "_RESTART_AFTER_S", 0.0)
    died = tmp_path / "died"
    scripts = {f"worker {number}": appends_to(died) + IS_KILLED for number in range(12)}
    with pytest.raises(BusError) as ended:
        run(scripts, config, lambda: False)
    assert "services died 17 times within 10 minutes, worker " in str(ended.value)
    assert "\n" not in str(ended.value)


@given(lives_s=st.floats(0.6, 149), services=st.integers(1, 30))
def test_however_long_a_service_lives_each_time_it_ends_the_host_within_some_deaths(
    lives_s: float, services: int
) -> None:
    deaths = host._Deaths(services)
    for number in range(1, 5):
        deaths.note("worker", -9, number * lives_s)
    with pytest.raises(BusError, match="worker was ended by SIGKILL 5 times in a row within 10 "):
        deaths.note("worker", -9, 5 * lives_s)


@given(services=st.integers(1, 64), seed=st.randoms())
def test_all_may_die_at_once_and_a_service_now_and_then_for_ever(
    services: int, seed: random.Random
) -> None:
    deaths = host._Deaths(services)
    for number in seed.sample(range(services), services):
        deaths.note(f"worker {number}", -9, 1.0)
    for hour in range(1, 50):
        deaths.note("worker 0", -9, hour * 3600.0)


@given(services=st.integers(1, 64))
def test_a_forkserver_that_dies_with_all_services_ends_the_host_the_fifth_time(
    services: int,
) -> None:
    deaths = host._Deaths(services)
    for number in range(4 * services):
        deaths.note(f"worker {number % services}", LOST, 1.0)
    with pytest.raises(BusError, match=r"worker 0 was lost, .* 5 times in a row within 10 "):
        deaths.note("worker 0", LOST, 1.0)


def test_a_service_that_gives_up_before_all_are_ready_ends_the_host_at_once(
    config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tried = tmp_path / "tried"
    scripts = {"fuser": appends_to(tried) + "raise SystemExit(1)", "featurizer": RUNS_ON}
    with pytest.raises(SystemExit) as ended:
        run(scripts, config, lambda: False)
    assert ended.value.code == 1
    assert len(lines(tried)) == 1
    assert not caplog.messages  # the service has said why


def test_a_service_that_gives_up_after_all_were_ready_is_started_again(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host, "_RESTART_AFTER_S", 0.0)
    keys, go, tried = Keys(config.run), tmp_path / "go", tmp_path / "tried"
    waits = f"import os, time\nwhile not os.path.exists({str(go)!r}): time.sleep(0.01)\n"
    command = [waits + appends_to(tried) + "raise SystemExit(1)"]
    stop = threading.Event()
    watch = threading.Thread(target=_stop_when, args=(lambda: len(lines(tried)) >= 2, stop))
    watch.start()
    announcing = threading.Thread(target=_announce_all, args=(config, keys, stop))
    announcing.start()
    try:
        run_host(SCRIPTS, {"fuser": command}, 1, config, stop, go.touch)
    finally:
        stop.set()
        watch.join()
        announcing.join()
    assert len(lines(tried)) >= 2


def _announce_all(config: Config, keys: Keys, stop: threading.Event) -> None:
    channel = keys.alive("channel", Part(0).identity("c"))
    with open_bus(config.bus) as bus:
        for token in (keys.alive("fuser", "a"), keys.alive("featurizer", "b"), channel):
            bus.declare_alive(token)
        stop.wait(60)


def test_a_service_that_ignores_the_stop_is_killed(config: Config, tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    deaf = "import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
    run({"deaf": deaf + appends_to(ready) + RUNS_ON}, config, ready.exists)


def test_services_get_their_settings_only_from_their_command(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _end_forkserver()  # it keeps the environment that it was started in
    monkeypatch.setenv("PLACEFIELD_RUNS", "from-outside")
    monkeypatch.setenv("NOTIFY_SOCKET", "@supervisor")
    monkeypatch.setenv("HOME", "/home")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    file = tmp_path / "environment"
    script = f"import os\nopen({str(file)!r}, 'w').write(str(dict(os.environ)))\n"
    run({"service": script + RUNS_ON}, config, lambda: bool(lines(file)))
    _end_forkserver()
    environment = literal_eval(file.read_text())
    assert environment["HOME"] == "/home"
    assert environment["OPENBLAS_NUM_THREADS"] == "1"
    assert not {"PLACEFIELD_RUNS", "PLACEFIELD_SUPERVISED", "NOTIFY_SOCKET"} & set(environment)
    assert "PLACEFIELD_RUNS" in os.environ


def test_a_service_with_a_defect_reports_it_as_the_main_program_would(
    config: Config, tmp_path: Path
) -> None:
    reported = tmp_path / "reported"
    script = f"import sys\nsys.excepthook = lambda *_: open({str(reported)!r}, 'w').close()\n1 / 0"
    with pytest.raises(SystemExit):
        run({"fuser": script}, config, lambda: False)
    assert reported.exists()


def test_an_endpoint_in_use_is_refused_before_anything_is_started(
    config: Config, tmp_path: Path
) -> None:
    started = tmp_path / "started"
    with (
        open_router(config.bus),
        pytest.raises(BusError, match=f"cannot listen at {config.bus.endpoint}"),
    ):
        run({"service": appends_to(started)}, config, lambda: False)
    assert not started.exists()


def test_the_host_is_ready_once_every_service_and_channel_is_alive(config: Config) -> None:
    keys, stop, ready = Keys(config.run), threading.Event(), threading.Event()
    reported: list[bool] = []

    def on_ready() -> None:
        reported.append(True)
        ready.set()

    served = threading.Thread(target=run_host, args=(SCRIPTS, {}, 2, config, stop, on_ready))
    served.start()
    tokens = [keys.alive("fuser", "a"), keys.alive("featurizer", "b")]
    tokens += [keys.alive("channel", Part(channel).identity("c")) for channel in (0, 1)]
    try:
        for _ in range(2):
            with open_bus(config.bus) as bus:
                for token in tokens[:-1]:
                    bus.declare_alive(token)
                assert reported or not ready.wait(0.3)
                bus.declare_alive(tokens[-1])
                assert ready.wait(60)
    finally:
        stop.set()
        served.join()
    assert reported == [True]


def test_the_end_of_a_service_by_a_signal_without_a_name_is_described() -> None:
    assert host._how_ended(1) == "ended with code 1"
    assert host._how_ended(-9) == "was ended by SIGKILL"
    assert host._how_ended(-35) == "was ended by signal 35"
