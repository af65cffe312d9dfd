from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from networks import write_network
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.descriptors import DescriptorStream, Moments
from placefield.features.extract import feature_of, feature_of_model
from placefield.features.fitting import fit_descriptors
from placefield.features.frames import Frame
from placefield.features.joined_model import (
    FeaturePart,
    JoinedModel,
    fit_parts,
    model_of_part,
    part_names,
)

WIDTHS = 20, 7
KINDS = "gist", "grayscale"

Array = NDArray[np.float32]


def raw_features(frames: int, seed: int = 0) -> Array:
    """Raw features of both parts, one of them at another place and of another spread."""
    rng = np.random.default_rng(seed)
    first = 5 + rng.normal(size=(frames, WIDTHS[0]))
    return np.hstack([first, 0.1 * rng.normal(size=(frames, WIDTHS[1]))]).astype(np.float32)


def fitted(*, standardise: bool = True, plain: bool = False) -> JoinedModel:
    parts = [FeaturePart(*each) for each in zip(KINDS, (None, None), WIDTHS, strict=True)]
    model, _ = fit_parts(
        [raw_features(50)], parts, dimensions=(8, 5), standardise=standardise, plain=plain
    )
    assert isinstance(model, JoinedModel)
    return model


@pytest.mark.parametrize("plain", [False, True])
def test_squared_distances_are_the_mean_of_those_of_the_parts_alone(plain: bool) -> None:
    raws, model = raw_features(50), fitted(plain=plain)
    separate = np.split(raws, [WIDTHS[0]], axis=1)
    squares = []
    for kind, own, most in zip(KINDS, separate, (8, 5), strict=True):
        _, (alone,) = fit_descriptors([own], kind, dimensions=most, standardise=True, plain=plain)
        squares.append(((alone[3:] - alone[2]) ** 2).sum(axis=1))
    joined = model.of_reference(raws)
    assert joined.shape == (50, model.dimensions) == (50, 13)
    found = ((joined[3:] - joined[2]) ** 2).sum(axis=1)
    np.testing.assert_allclose(found, np.mean(squares, axis=0), rtol=1e-4)


@pytest.mark.parametrize("standardise", [True, False])
def test_a_stream_joins_what_the_streams_of_its_parts_give(standardise: bool) -> None:
    model, raws = fitted(standardise=standardise), raw_features(9, seed=1)
    stream, own = model.new_stream(), [DescriptorStream(part) for part in model.parts]
    for raw in raws:
        separate = zip(own, np.split(raw, [WIDTHS[0]]), strict=True)
        expected = np.concatenate([one.update(part) for one, part in separate]) / np.sqrt(2)
        found = stream.update(raw)
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        assert found is not None
        assert model.checked(found) is found


def test_a_stream_that_is_continued_by_its_moments_gives_the_same_bits() -> None:
    model, raws = fitted(), raw_features(9, seed=1)
    whole, before = model.new_stream(), model.new_stream()
    expected = [whole.update(raw) for raw in raws]
    for raw in raws[:4]:
        before.update(raw)
    after = model.new_stream(Moments(before.moments.frames, before.moments.sums))
    np.testing.assert_array_equal([after.update(raw) for raw in raws[4:]], expected[4:])


def test_a_frame_of_which_a_part_is_blank_or_bad_leaves_no_trace() -> None:
    model, raws = fitted(), raw_features(4, seed=1)
    disturbed, other = model.new_stream(), model.new_stream()
    blank, broken = raws[0].copy(), raws[0].copy()
    blank[: WIDTHS[0]] = 3
    broken[-1] = np.nan
    disturbed.update(raws[0])
    other.update(raws[0])
    assert disturbed.update(blank) is None
    for bad in (broken, raws[0][1:]):
        with pytest.raises(FrameError):
            disturbed.update(bad)
    np.testing.assert_array_equal(disturbed.update(raws[1]), other.update(raws[1]))


def test_restored_features_have_the_descriptors_that_they_were_restored_from() -> None:
    model = fitted()
    descriptors = model.of_reference(raw_features(50))
    restored = model.restored(descriptors)
    assert restored.shape == (50, sum(WIDTHS))
    for part, own, wanted in zip(
        model.parts,
        model.split(restored),
        np.split(descriptors * np.sqrt(2), [8], axis=1),
        strict=True,
    ):
        # What is restored is not of unit length, so it must not be divided by its own.
        found = part.reduce((own - part.mean) / part.deviation)
        np.testing.assert_allclose(found, wanted, atol=1e-4)


def test_the_raw_feature_of_several_parts_has_each_at_unit_length(tmp_path: Path) -> None:
    network = tmp_path / "a+b.onnx"
    write_network(network)
    image = np.random.default_rng(5).integers(0, 256, (96, 128, 3), np.uint8)
    feature = feature_of(f"gist+onnx:{network}")
    alone = [feature_of(kind).describe(image) for kind in ("gist", f"onnx:{network}")]
    expected = np.concatenate([one / np.linalg.norm(one) for one in alone])
    np.testing.assert_allclose(feature.describe(image), expected, rtol=1e-5)
    assert [part.width for part in feature.parts] == list(map(len, alone))


def test_a_part_alone_describes_the_same_image_as_among_all_parts() -> None:
    one, other = fitted().parts
    joined = JoinedModel((replace(one, least_side=64), replace(other, least_side=256)))
    pixels = cv2.resize(
        np.random.default_rng(5).integers(0, 256, (48, 64, 3), np.uint8), (768, 512)
    )
    frame = Frame(0, 0, "a", cv2.imencode(".jpg", pixels)[1].tobytes())
    among_all = feature_of_model(joined).parts_of_frame(frame, (0, 1))
    for number in (0, 1):
        alone = feature_of_model(model_of_part(joined, number)).of_frame(frame)
        np.testing.assert_array_equal(alone, among_all[number])


@pytest.mark.parametrize(
    ("kinds", "names"),
    [
        (("gist", "onnx:/c/net.onnx"), ["gist", "net"]),
        (("onnx:a/net.onnx", "onnx:b/net.onnx"), ["onnx:a/net.onnx", "onnx:b/net.onnx"]),
        (("gist", "onnx:gist.onnx"), ["gist", "onnx:gist.onnx"]),
    ],
)
def test_each_part_has_a_name_that_no_other_part_has(
    kinds: tuple[str, ...], names: list[str]
) -> None:
    parts = zip(fitted().parts, kinds, strict=True)
    assert part_names(JoinedModel(tuple(replace(part, kind=kind) for part, kind in parts))) == names
