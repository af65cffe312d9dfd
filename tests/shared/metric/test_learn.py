import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from placefield.config import MetricConfig
from placefield.metric.gate import Probes, passes_gate, probe_score
from placefield.metric.learn import held_back_frames, learn_projection

LMNN = MetricConfig(kind="lmnn")


def made_route(weather_is_random):
    """A route of 120 frames in segments of 10: six dimensions of place and six of weather.

    The weather changes from frame to frame, or with the segments, so that on this traverse it tells
    them apart; in the probes it is always another one.
    """
    rng = np.random.default_rng(0)
    labels = np.arange(120) // 10
    place = gaussian_filter1d(rng.normal(size=(120, 6)), 2, axis=0)
    place /= place.std()
    weather = rng.normal(size=(120 if weather_is_random else 12, 6))
    weather = 1.5 * weather if weather_is_random else 4 * weather[labels]
    descriptors = np.hstack([place, weather]).astype(np.float32)
    descriptors -= descriptors.mean(axis=0)

    held_back = held_back_frames(120, 0.2, seed=0)
    truth = np.flatnonzero(held_back)
    observed = descriptors[truth] + rng.normal(size=(len(truth), 12)).astype(np.float32) * 0.1
    observed[:, 6:] = 1.5 * rng.normal(size=(len(truth), 6))
    return descriptors, labels, held_back, Probes(descriptors, observed, truth)


def learned(descriptors, labels, held_back, *rest, **options):
    """Learn on the frames that are not held back."""
    order = np.argsort(held_back, kind="stable")
    trained = np.count_nonzero(~held_back)
    return learn_projection(descriptors[order], labels[order], trained, *rest, **options)


def test_a_metric_that_ignores_the_weather_is_learned():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    metric = learned(descriptors, labels, held_back, probes, LMNN, 0)
    assert metric.learned
    assert probe_score(metric.projection, probes) > probe_score(None, probes)
    of_place = np.linalg.norm(metric.projection[:, :6])
    assert of_place > 1.5 * np.linalg.norm(metric.projection[:, 6:])


def test_a_metric_that_fits_the_weather_of_its_traverse_is_refused():
    descriptors, labels, held_back, probes = made_route(weather_is_random=False)
    metric = learned(descriptors, labels, held_back, probes, LMNN, 0)
    assert metric.curve[:, 0].min() < metric.curve[0, 0]
    assert not metric.learned
    np.testing.assert_array_equal(metric.projection, np.eye(12))


def test_the_mean_squared_distance_of_the_reference_stays():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    projection = learned(descriptors, labels, held_back, probes, LMNN, 0).projection

    def mean_distance(points):
        return ((points[:, None] - points) ** 2).sum(axis=-1).mean()

    expected = mean_distance(descriptors)
    assert mean_distance(descriptors @ projection.T) == pytest.approx(expected, rel=1e-4)


def test_a_learned_metric_keeps_only_the_dimensions_that_it_was_asked_for():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    whole, part = (
        learned(descriptors, labels, held_back, probes, settings, 0).projection
        for settings in (
            LMNN.model_copy(update={"kept": kept, "gate": False}) for kept in (1.0, 0.96)
        )
    )
    assert whole.shape == (12, 12)
    assert part.shape[0] < part.shape[1] == 12


def test_the_unit_of_the_descriptors_does_not_matter():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    unit = np.float32(256)  # a power of two: no rounding
    in_unit = Probes(unit * probes.places, unit * probes.descriptors, probes.truth)
    expected = learned(descriptors, labels, held_back, probes, LMNN, 0)
    other = learned(unit * descriptors, labels, held_back, in_unit, LMNN, 0)
    np.testing.assert_allclose(other.projection, expected.projection, atol=1e-4)
    np.testing.assert_allclose(other.curve, expected.curve, rtol=1e-4)


def test_held_back_frames_are_not_trained_on():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    mislabelled = np.where(held_back, np.roll(labels, 60), labels)
    expected = learned(descriptors, labels, held_back, probes, LMNN, 0)
    other = learned(descriptors, mislabelled, held_back, probes, LMNN, 0)
    steps = min(len(expected.curve), len(other.curve))
    assert steps > 5
    np.testing.assert_array_equal(other.curve[:steps, 1], expected.curve[:steps, 1])
    assert (other.curve[:steps, 0] != expected.curve[:steps, 0]).all()


def test_segments_that_are_held_back_whole_do_not_validate():
    descriptors, labels, _, probes = made_route(weather_is_random=True)
    metric = learned(descriptors, labels, labels % 4 == 0, probes, LMNN, 0)
    assert (metric.curve[:, 0] == 0).all()
    assert not metric.learned


def test_the_curve_starts_with_the_identity_and_ends_soon_after_the_best_validation_loss():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    settings = LMNN.model_copy(update={"steps": 500, "kept": 1.0})
    observed = []
    metric = learned(
        descriptors,
        labels,
        held_back,
        probes,
        settings,
        0,
        on_step=lambda *step: observed.append(step),
    )
    losses, scores = metric.curve.T
    best = int(np.argmin(losses))
    assert scores[0] == pytest.approx(probe_score(None, probes))
    assert scores[best] == pytest.approx(probe_score(metric.projection, probes), abs=1e-4)
    assert len(losses) == best + 1 + 5
    assert observed == [(step, *metric.curve[step]) for step in range(1, len(losses))]


def test_same_input_gives_the_same_bits():
    route = made_route(weather_is_random=True)
    first, second = (learned(*route, LMNN, 0) for _ in range(2))
    assert first.projection.tobytes() == second.projection.tobytes()
    assert first.curve.tobytes() == second.curve.tobytes()


@pytest.mark.parametrize("kind", ["rca", "lfda"])
def test_metric_learns_metrics_are_held_to_the_same_gate_and_scale(kind):
    config = MetricConfig(kind=kind)
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    route = descriptors, labels + 1, held_back, probes
    metric = learned(*route, config, 0)
    assert metric.learned
    assert passes_gate(metric.projection, probes)
    assert metric.curve.shape == (2, 2)
    assert metric.curve[1, 1] == pytest.approx(probe_score(metric.projection, probes), rel=1e-4)
    expected = np.linalg.norm(descriptors)
    assert np.linalg.norm(descriptors @ metric.projection.T) == pytest.approx(expected, rel=1e-4)
    again = learned(*route, config, 0)
    assert again.projection.tobytes() == metric.projection.tobytes()

    unknown = Probes(probes.places, probes.descriptors, (probes.truth + 60) % 120)
    refused = learned(descriptors, labels + 1, held_back, unknown, config, 0)
    assert "does not recognise places better" in refused.refusal
    np.testing.assert_array_equal(refused.projection, np.eye(12))


def test_where_nothing_can_be_learned_the_refusal_says_why():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    inactive = np.zeros_like(labels)
    metric = learned(descriptors, inactive, held_back, probes, MetricConfig(kind="rca"), 0)
    assert "fewer than two segments" in metric.refusal
    assert metric.curve.shape == (1, 2)
    np.testing.assert_array_equal(metric.projection, np.eye(12))


def test_segments_of_one_frame_leave_the_identity():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    metric = learned(descriptors, np.arange(len(labels)), held_back, probes, LMNN, 0)
    assert not metric.learned
    np.testing.assert_array_equal(metric.projection, np.eye(12))


def test_a_second_traverse_is_stacked_and_its_held_back_frames_can_be_the_probes():
    descriptors, labels, held_back, probes = made_route(weather_is_random=True)
    second = descriptors.copy()
    second[:, 6:] = 1.5 * np.random.default_rng(7).normal(size=(120, 6))
    both = np.vstack([descriptors, second])
    both -= both.mean(axis=0)
    probes = Probes(descriptors, second[held_back], probes.truth)
    metric = learned(both, np.tile(labels, 2), np.tile(held_back, 2), probes, LMNN, 0)
    assert metric.learned
    assert passes_gate(metric.projection, probes)


@given(count=st.integers(1, 500), fraction=st.floats(0, 1), seed=st.integers(0, 99))
def test_held_back_frames_are_whole_blocks_of_about_the_fraction(count, fraction, seed):
    held_back = held_back_frames(count, fraction, seed)
    assert held_back.shape == (count,)
    assert abs(held_back.sum() - fraction * count) <= 4.5
    for start in range(0, count, 3):
        assert len(set(held_back[start : start + 3])) == 1
    np.testing.assert_array_equal(held_back, held_back_frames(count, fraction, seed))
