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


def test_between_places_without_a_pose_it_reaches_to_the_next_ones_with_one() -> None:
    gappy = PLACES.copy()
    gappy[15:20] = gappy[21:27] = np.nan
    wide = pose_covariance(gappy, 20, 3, 0.99)
    expected = pose_covariance(PLACES[[14, 20, 27]], 1, 0, 0.99)
    np.testing.assert_allclose(wide, expected)


@pytest.mark.parametrize("missing", [slice(0, 20), slice(21, 50)])
def test_where_no_pose_is_known_up_to_an_end_nothing_is_said(missing: slice) -> None:
    gappy = PLACES.copy()
    gappy[missing] = np.nan
    assert np.diag(pose_covariance(gappy, 20, 3, 0.99)).tolist() == [HIGHEST] * 6
