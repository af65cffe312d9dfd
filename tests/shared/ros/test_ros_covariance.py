import numpy as np
import pytest
from scipy import stats

from placefield.fusion.uncertainty import HIGHEST
from placefield.ros.covariance import pose_covariance

# Along x, a place every 2 m, turning by 0.1 rad a place through the angle where it wraps.
PLACES = np.stack([2.0 * np.arange(50), np.zeros(50), 3 + 0.1 * np.arange(50)], axis=1)
PLACES[:, 2] = (PLACES[:, 2] + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("probability", [0.5, 0.99, 0.9999])
@pytest.mark.parametrize("tolerance", [0, 3])
def test_it_is_within_reach_with_the_match_s_probability(
    tolerance: int, probability: float
) -> None:
    covariance = pose_covariance(PLACES, 20, tolerance, probability)
    reach = 2.0 * (tolerance + 1)
    in_plane = stats.rayleigh(scale=np.sqrt(covariance[0, 0]))
    assert in_plane.cdf(reach) == pytest.approx(probability)
    yaw = stats.norm(scale=np.sqrt(covariance[5, 5]))
    turned = 0.1 * (tolerance + 1)
    if covariance[5, 5] > 1e-2:
        assert yaw.cdf(turned) - yaw.cdf(-turned) == pytest.approx(probability)


def test_nothing_is_said_of_height_roll_and_pitch() -> None:
    covariance = pose_covariance(PLACES, 20, 3, 0.99)
    assert covariance[1, 1] == covariance[0, 0]
    assert np.diag(covariance)[2:5].tolist() == [HIGHEST] * 3
    assert np.array_equal(covariance, np.diag(np.diag(covariance)))


@pytest.mark.parametrize("place", [0, 49])
@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_it_is_positive_and_finite_at_the_ends_of_all(place: int, probability: float) -> None:
    for poses in (PLACES, np.zeros_like(PLACES)):
        variances = np.diag(pose_covariance(poses, place, 3, probability))
        assert (variances > 0).all()
        assert (variances <= HIGHEST).all()
