"""What is said of the machine, with counters and speeds that are made up."""

import os
import subprocess
import sys

import pytest

from placefield_tools.bench import machine
from placefield_tools.bench.figure import Figure, as_object


def test_figures_of_the_machine_follow_those_that_were_measured() -> None:
    found = machine.with_machine(lambda: [Figure("speedup", 3.0, "")])
    assert found[0].key == "speedup"
    numbers = as_object(found)
    assert 0 <= numbers["machine_others"] <= 1
    for when in ("before", "after"):
        assert numbers[f"machine_gb_per_s_{when}"] > 0
        assert numbers[f"machine_gflops_{when}"] > 0


@pytest.mark.parametrize(
    ("idle", "own", "others"), [(8, 12, 0), (3, 12, 0.25), (0, 0, 1), (8, 12.01, 0)]
)
def test_others_take_what_is_neither_idle_nor_our_own(
    monkeypatch: pytest.MonkeyPatch, idle: float, own: float, others: float
) -> None:
    monkeypatch.setattr(machine.psutil, "cpu_count", lambda: 2)
    start, end = machine._Moment(100, 50, 4), machine._Moment(110, 50 + idle, 4 + own)
    assert end.others_since(start) == pytest.approx(others)  # of 20 s of computing


_LEAVES_A_BUSY_CHILD = """
import os, time
if os.fork() == 0:
    while time.process_time() < 0.5:
        pass
    os.write(1, b"done")
"""


def test_a_process_whose_parent_has_ended_is_our_own() -> None:
    def measure() -> list[Figure]:
        ended = subprocess.run(
            [sys.executable, "-c", _LEAVES_A_BUSY_CHILD], check=True, capture_output=True
        )
        assert ended.stdout == b"done"
        return []

    before = sum(os.times()[2:4])
    machine.with_machine(measure)
    assert sum(os.times()[2:4]) - before >= 0.45
