import numpy as np
import pytest

from placefield.maps.plausible_steps import implausible_steps

NOBODY_KNOWS = [np.nan, np.nan]


def at_ten_hertz(count: int) -> np.ndarray:
    return np.arange(count, dtype=np.int64) * 100_000_000


@pytest.mark.parametrize("metres", [12, 200, 40_000])
def test_a_step_that_is_too_fast_is_reported_by_its_frames(metres: float) -> None:
    x = np.arange(20) / 2
    x[7:] += metres
    poses = np.column_stack([x, np.zeros(20)])
    reported = implausible_steps(poses, at_ten_hertz(20))
    assert reported is not None
    assert "from frame 6 to 7" in reported
    assert "\n" not in reported


@pytest.mark.parametrize("step", [0.0, 0.5, 3.0, 90.0])
def test_a_steady_drive_does_not_jump_however_fast(step: float) -> None:
    jitter = np.random.default_rng(1).normal(scale=0.2, size=(50, 2))
    poses = jitter + np.arange(50)[:, np.newaxis] * (step, 0)
    assert implausible_steps(poses, at_ten_hertz(50) if step < 9 else None) is None


def test_a_gap_is_no_jump_where_there_was_time_to_drive() -> None:
    poses = np.column_stack([np.arange(40.0), np.zeros(40)])
    poses[5:35] = NOBODY_KNOWS
    assert implausible_steps(poses, at_ten_hertz(40)) is None
    assert (
        implausible_steps(np.array([NOBODY_KNOWS, [0, 0], NOBODY_KNOWS]), at_ten_hertz(3)) is None
    )
