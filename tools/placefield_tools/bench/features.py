"""GIST beside a naive implementation, and a frame's way to its descriptor."""

import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.features.descriptor_stage import DescriptorStage, warm_up
from placefield.features.descriptors import DescriptorModel, DescriptorStream
from placefield.features.extract import (
    GIST_SIZE,
    default_dimensions,
    feature_of,
    least_side_of,
)
from placefield.features.fitting import fit_descriptors
from placefield.features.gist import DIMENSIONS, gist
from placefield.features.images import decode
from placefield.features.kinds import DESCRIPTOR, FeatureKind
from placefield.features.shrink import small_grey
from placefield_tools.bench.feature_speed import feature_figures
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.gist_limit import bare, gist_work
from placefield_tools.bench.naive_gist import NaiveGist
from placefield_tools.bench.street_frames import street_frames
from placefield_tools.bench.timing import Timings
from placefield_tools.sources import open_source

_BATCH = 16
_LARGE_BATCH = 4
_GIVEN = 500

Array = NDArray[np.float32]


def bench_features(feature: FeatureKind | None = None) -> list[Figure]:
    """Measure on JPEGs of 640 x 480 and larger ones, on one core.

    Args:
        feature: measures only this one; None: GIST, beside other implementations.

    Raises:
        ConfigError: see ``feature_figures``.
    """
    if feature is not None:
        return feature_figures(feature)
    jpegs = street_frames(_BATCH)
    small = np.stack([small_grey(decode(jpeg), GIST_SIZE, GIST_SIZE) for jpeg in jpegs])
    return [
        *_gist_figures(small),
        *_descriptor_figures(jpegs),
        *_large_figures("1080p", (1920, 1080), at_least=2.5),
        *_large_figures("4k", (3840, 2160), at_least=3),
        _given_descriptors(),
    ]


def _gist_figures(images: Array) -> list[Figure]:
    naive = NaiveGist(GIST_SIZE)
    expected = np.array([naive(image) for image in images])
    difference = np.abs(gist(images) - expected).max() / np.abs(expected).max()
    work = gist_work(GIST_SIZE)
    least = bare(work)
    times = Timings.of(
        [
            lambda: [naive(image) for image in images],
            lambda: [gist(image) for image in images],
            lambda: gist(images),
            lambda: [least() for _ in images],
        ],
        compared=[(0, 1), (0, 2), (1, 3)],
    )
    return [
        Figure("gist_speedup", times.ratio(0, 1), "naive GIST over ours, by frame", at_least=8),
        Figure("gist_batch_speedup", times.ratio(0, 2), f"in batches of {_BATCH}", at_least=8),
        Figure(
            "gist_difference",
            float(difference),
            "largest difference from the naive one, over its largest value",
            at_most=1e-5,
        ),
        Figure("gist_ms", 1e3 * times.median(1) / _BATCH, "ours, a frame"),
        Figure(
            "gist_limit_ms",
            1e3 * times.median(3) / _BATCH,
            f"its {work.products / 1e6:.1f} M products and {work.bytes_read / 1e6:.1f} MB alone",
        ),
        Figure("gist_over_limit", times.ratio(1, 3), "ours over these", at_most=1.5),
    ]


def _descriptor_figures(jpegs: list[bytes]) -> list[Figure]:
    feature, stream = feature_of("gist"), DescriptorStream(_model())
    times = Timings.of(
        [
            lambda: [stream.update(feature.describe(jpeg)) for jpeg in jpegs],
            lambda: [cv2.imdecode(_as_array(jpeg), cv2.IMREAD_COLOR) for jpeg in jpegs],
        ],
        compared=[(0, 1)],
    )
    return [
        Figure(
            "descriptor_over_decoding",
            times.ratio(0, 1),
            "JPEG 640 x 480 to descriptor, over the time of cv2.imdecode",
            at_most=2.5,
        ),
        Figure("features_frames_per_s", _BATCH / times.median(0), "JPEG to descriptor, one core"),
    ]


def _large_figures(name: str, size: tuple[int, int], at_least: float) -> list[Figure]:
    """Compare JPEGs that are decoded whole with those that are decoded to a part of their size."""
    jpegs = street_frames(_LARGE_BATCH, size=size)
    model = _model()
    whole = DescriptorStage(model)
    in_part = DescriptorStage(replace(model, least_side=least_side_of("gist", None)))
    warm_up(whole)  # as a service does
    times = Timings.of(
        [lambda: _described_images(whole, jpegs), lambda: _described_images(in_part, jpegs)],
        compared=[(0, 1)],
    )
    return [
        Figure(
            f"jpeg_{name}_speedup",
            times.ratio(0, 1),
            f"JPEG {size[0]} x {size[1]} to descriptor, decoded whole over decoded in part",
            at_least=at_least,
        ),
        Figure(f"jpeg_{name}_whole_ms", 1e3 * times.median(0) / _LARGE_BATCH, "whole, a frame"),
        Figure(f"jpeg_{name}_ms", 1e3 * times.median(1) / _LARGE_BATCH, "in part, a frame"),
    ]


def _described_images(stage: DescriptorStage, jpegs: list[bytes]) -> list[Array | None]:
    stream = stage.new_stream()
    return [stream.update(jpeg) for jpeg in jpegs]


def _given_descriptors() -> Figure:
    model = _model(DESCRIPTOR)
    rows = np.random.default_rng(1).random((_GIVEN, DIMENSIONS), np.float32)
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        path = Path(folder) / "drive.npy"
        np.save(path, rows)
        times = Timings.of([lambda: _described(path, model)])
    return Figure(
        "given_descriptors_per_s",
        _GIVEN / times.median(0),
        f"row of {DIMENSIONS} numbers of a .npy to descriptor, one core",
    )


def _described(path: Path, model: DescriptorModel) -> list[Array | None]:
    stream = DescriptorStage(model).new_stream()
    with open_source(str(path)) as source:
        return [stream.update_frame(frame) for frame in source]


def _as_array(jpeg: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(jpeg, np.uint8)


def _model(kind: str = "gist") -> DescriptorModel:
    """Fit a model of the usual size; what it was fitted on makes no difference to its speed."""
    dimensions = default_dimensions("gist")
    raws = np.random.default_rng(0).random((2 * dimensions, DIMENSIONS), np.float32)
    return fit_descriptors([raws], kind, dimensions=dimensions, standardise=True)[0]
