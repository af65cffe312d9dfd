import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.decomposition import PCA
from sklearn.preprocessing import normalize, scale

from placefield.errors import FrameError
from placefield.features.descriptors import (
    PRIOR_FRAMES,
    DescriptorModel,
    DescriptorStream,
    unit_length,
)
from placefield.features.fitting import fit_descriptors

Array = NDArray[np.float32]


def raw_features(frames: int, seed: int = 0, dimensions: int = 20) -> Array:
    rng = np.random.default_rng(seed)
    spread = rng.uniform(0.5, 3, dimensions)
    return (5 + spread * rng.normal(size=(frames, dimensions))).astype(np.float32)


def fitted(*, standardise: bool = True, plain: bool = False) -> DescriptorModel:
    return fit_descriptors(
        [raw_features(50)], "gist", dimensions=8, standardise=standardise, plain=plain
    )[0]


def test_reference_descriptors_are_those_of_scikit_learn() -> None:
    raw = raw_features(50)
    model, (descriptors,) = fit_descriptors([raw], "gist", dimensions=8, standardise=True)
    standardised = scale(normalize(raw.astype(np.float64)))
    pca = PCA(8).fit(standardised)
    signs = np.sign(np.sum(pca.components_ * model.components, axis=1))
    np.testing.assert_allclose(model.components, signs[:, None] * pca.components_, atol=1e-4)
    expected = normalize(signs * pca.transform(standardised))
    np.testing.assert_allclose(descriptors, expected, atol=1e-4)


def test_a_second_traverse_is_standardised_by_itself_and_shares_the_axes() -> None:
    raws = [raw_features(50), raw_features(40, seed=1)]
    model, descriptors = fit_descriptors(raws, "gist", dimensions=8, standardise=True)
    standardised = [scale(normalize(raw.astype(np.float64))) for raw in raws]
    pca = PCA(8).fit(np.concatenate(standardised))
    likeness = np.abs(np.sum(pca.components_ * model.components, axis=1))
    np.testing.assert_allclose(likeness, 1, atol=1e-4)
    expected = normalize(standardised[1] @ model.components.T.astype(np.float64))
    np.testing.assert_allclose(descriptors[1], expected, atol=1e-4)


def test_without_standardisation_every_traverse_has_the_references_moments() -> None:
    raws = [raw_features(50), raw_features(40, seed=1)]
    model, descriptors = fit_descriptors(raws, "gist", dimensions=8, standardise=False)
    stream = DescriptorStream(model)
    for raw, traverse in zip(raws, descriptors, strict=True):
        np.testing.assert_allclose([stream.update(frame) for frame in raw], traverse, atol=1e-5)


@pytest.mark.parametrize(("frames", "dimensions"), [(5, 4), (1, 0), (50, 20)])
def test_there_are_no_more_dimensions_than_the_frames_span(frames: int, dimensions: int) -> None:
    model, (descriptors,) = fit_descriptors(
        [raw_features(frames)], "gist", dimensions=300, standardise=True
    )
    assert model.components.shape == (dimensions, 20)
    assert descriptors.shape == (frames, dimensions)


def test_a_streams_moments_run_over_its_frames_and_twenty_of_the_reference() -> None:
    model = fitted()
    # Half a deviation's worth of frames on either side of the mean have just that deviation.
    prior = np.concatenate(
        [np.tile(model.mean + side * model.deviation, (PRIOR_FRAMES // 2, 1)) for side in (-1, 1)]
    )
    assert len(prior) == 20
    query = raw_features(70, seed=2) + 4
    units = normalize(query.astype(np.float64))
    stream = DescriptorStream(model)
    for newest in range(len(query)):
        seen = np.concatenate([prior, units[: newest + 1]])
        standardised = (units[newest] - seen.mean(axis=0)) / seen.std(axis=0)
        (expected,) = normalize([standardised @ model.components.T.astype(np.float64)])
        np.testing.assert_allclose(stream.update(query[newest]), expected, atol=1e-4)


@given(st.lists(st.lists(st.floats(0, 255, width=32), min_size=20, max_size=20), max_size=5))
def test_descriptors_are_finite_and_of_unit_length_whatever_comes(query: list[list[float]]) -> None:
    stream = DescriptorStream(fitted())
    for raw in [[0.0] * 20, *query, [0.0] * 20]:
        descriptor = stream.update(np.asarray(raw, np.float32))
        if descriptor is None:
            assert max(raw) - min(raw) <= 1e-5 * max(raw)
            continue
        assert descriptor.dtype == np.float32
        assert np.linalg.norm(descriptor) == pytest.approx(1, abs=1e-5)


def test_a_zero_vector_has_no_direction() -> None:
    vectors = np.array([[0, 0], [3, 4]], np.float32)
    expected = np.array([[0, 0], [0.6, 0.8]], np.float32)
    np.testing.assert_allclose(unit_length(vectors), expected, rtol=1e-6)


@pytest.mark.parametrize("length", [1 - 1e-5, 1, 1 + 1e-5])
def test_descriptors_of_length_1_are_taken(length: float) -> None:
    descriptor = np.full(8, length / np.sqrt(8), np.float32)
    assert fitted().checked(descriptor) is descriptor


def test_one_of_length_0_is_of_a_frame_that_was_not_seen() -> None:
    assert fitted().checked(np.zeros(8, np.float32)) is None


def test_where_there_is_nothing_to_see_there_is_no_descriptor_and_the_stream_stays() -> None:
    disturbed, other = DescriptorStream(fitted()), DescriptorStream(fitted())
    for raw in raw_features(3, seed=2):
        for value in (0, 7, 200):
            assert disturbed.update(np.full(20, value, np.float32)) is None
        np.testing.assert_array_equal(disturbed.update(raw), other.update(raw))


@pytest.mark.parametrize("shape", [(7,), (9,), (1, 8), (8, 1), ()])
def test_a_descriptor_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(FrameError, match="shape"):
        fitted().checked(np.zeros(shape, np.float32))


@pytest.mark.parametrize("value", [0, 0.4, 0.6, -2, 3e38, np.inf, -np.inf, np.nan])
def test_a_descriptor_of_another_length_or_not_finite_is_refused(value: float) -> None:
    with pytest.raises(FrameError, match="length"):
        fitted().checked(np.array([0.9, value, *[0] * 6], np.float32))


@pytest.mark.parametrize("standardise", [True, False])
@pytest.mark.parametrize(
    "wrong", [np.ones(19), np.ones((1, 20)), np.full(20, np.nan), np.full(20, np.inf)]
)
def test_a_feature_that_is_refused_leaves_the_stream_as_it_was(
    wrong: NDArray[np.float64], standardise: bool
) -> None:
    model = fitted(standardise=standardise)
    disturbed, other = DescriptorStream(model), DescriptorStream(model)
    for raw in raw_features(3, seed=2):
        with pytest.raises(FrameError, match="feature"):
            disturbed.update(wrong.astype(np.float32))
        np.testing.assert_array_equal(disturbed.update(raw), other.update(raw))


def test_plain_descriptors_are_those_of_scikit_learn_in_one_unit() -> None:
    raw = raw_features(50)
    model, (descriptors,) = fit_descriptors(
        [raw], "gist", dimensions=8, standardise=True, plain=True
    )
    pca = PCA(8).fit(raw.astype(np.float64))
    signs = np.sign(np.sum(pca.components_ * model.components, axis=1))
    expected = signs * pca.transform(raw)
    longest = np.linalg.norm(expected, axis=1).max()
    np.testing.assert_allclose(descriptors, expected / (4 * longest), atol=1e-5)
    assert model.variance_kept == pytest.approx(pca.explained_variance_ratio_.sum(), abs=1e-5)


@pytest.mark.parametrize(("frames", "dimensions"), [(15, 10), (15, 40), (50, 5)])
def test_the_share_of_variance_that_is_kept_is_scikit_learns(frames: int, dimensions: int) -> None:
    raw = raw_features(frames)
    model, _ = fit_descriptors([raw], "gist", dimensions=dimensions, standardise=True)
    pca = PCA(min(dimensions, frames - 1, 20)).fit(scale(normalize(raw.astype(np.float64))))
    assert model.variance_kept == pytest.approx(pca.explained_variance_ratio_.sum(), abs=1e-5)


def test_a_plain_query_depends_on_no_frame_before_and_may_be_4_times_as_far_as_the_farthest() -> (
    None
):
    model = fitted(plain=True)
    stream, raws = DescriptorStream(model), raw_features(9, seed=1)
    for raw in raws:
        np.testing.assert_array_equal(stream.update(raw), model.of_reference(raw))
    far = model.mean + 3.9 * (raw_features(50) - model.mean)
    longest = max(far, key=lambda raw: float(np.linalg.norm(model.of_reference(raw))))
    descriptor = stream.update(longest)
    assert descriptor is not None
    assert np.linalg.norm(descriptor) == pytest.approx(3.9 / 4, abs=1e-3)
    with pytest.raises(FrameError, match=r"length 1.* not 1 at most"):
        stream.update(model.mean + (longest - model.mean) * 1.1)


@pytest.mark.parametrize("value", [1.1, -2, 3e38, np.inf, -np.inf, np.nan])
def test_a_plain_descriptor_is_refused_if_it_is_longer_than_1_or_not_finite(value: float) -> None:
    model = fitted(plain=True)
    short = np.array([0.2] * 8, np.float32)
    assert model.checked(short) is short
    with pytest.raises(FrameError, match="length"):
        model.checked(np.array([0.1, value, *[0] * 6], np.float32))
