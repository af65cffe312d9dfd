"""The machine, as a doctor sees it."""

from pathlib import Path

import psutil
import pytest

from placefield_tools.doctor import machine
from placefield_tools.doctor.finding import Health


@pytest.mark.parametrize(
    ("count", "load", "verdict"),
    [(4, 0.5, Health.GOOD), (1, 0.5, Health.WARNING), (4, 6.0, Health.WARNING)],
)
def test_few_or_busy_cores_are_a_warning(count: int, load: float, verdict: Health) -> None:
    assert machine.of_cores(count, load).verdict is verdict


def test_little_memory_is_a_warning() -> None:
    assert machine.of_memory(2**30).verdict is Health.WARNING
    assert machine.of_memory(8 * 2**30).found == "8.0 GiB available"


def test_the_memory_is_what_the_system_says() -> None:
    (found,) = (one for one in machine.machine() if one.subject == "memory")
    available = psutil.virtual_memory().available / 2**30
    assert float(found.found.split()[0]) == pytest.approx(available, abs=1.0)


def test_a_system_without_shared_memory_is_reported_what_to_do(tmp_path: Path) -> None:
    assert machine.of_shared_memory(tmp_path / "none").verdict is Health.WARNING


def test_a_folder_that_cannot_be_written_to_keeps_no_loops(tmp_path: Path) -> None:
    assert machine.compiled_loops(tmp_path).verdict is Health.GOOD
    found = machine.compiled_loops(tmp_path / "none")
    assert found.verdict is Health.WARNING
    assert "NUMBA_CACHE_DIR" in found.advice
