"""From JPEG to descriptor by any feature, beside decoding alone."""

import numpy as np

from placefield.errors import ConfigError
from placefield.features.descriptor_stage import DescriptorStage, warm_up
from placefield.features.extract import Feature, default_dimensions, feature_of
from placefield.features.images import decode
from placefield.features.joined_model import AnyModel, fit_parts
from placefield.features.kinds import DESCRIPTOR, FeatureKind
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.street_frames import street_frames
from placefield_tools.bench.timing import Timings

_SIZES = ((640, 480), (1920, 1080), (3840, 2160))
_FRAMES = 4  # a round


def feature_figures(kind: FeatureKind) -> list[Figure]:
    """Measure JPEGs of several sizes, on one core.

    Raises:
        ConfigError: the feature is not of images, or see ``feature_of``.
    """
    if kind == DESCRIPTOR:
        raise ConfigError(f"--feature {DESCRIPTOR}: give a feature of images")
    stage = DescriptorStage(_model_of(feature_of(kind)))
    warm_up(stage)
    return [figure for size in _SIZES for figure in _figures_of(stage, size)]


def _figures_of(stage: DescriptorStage, size: tuple[int, int]) -> list[Figure]:
    name = "{}x{}".format(*size)
    jpegs, stream = street_frames(_FRAMES, size=size), stage.new_stream()
    times = Timings.of(
        [
            lambda: [stream.update(jpeg) for jpeg in jpegs],
            lambda: [decode(jpeg) for jpeg in jpegs],
        ],
        compared=[(0, 1)],
    )
    frame_ms = 1e3 * times.median(0) / _FRAMES
    return [
        Figure(f"feature_{name}_ms", frame_ms, f"JPEG {name} to descriptor, a frame, one core"),
        Figure(f"feature_{name}_over_decoding", times.ratio(0, 1), "over decoding it whole"),
    ]


def _model_of(feature: Feature) -> AnyModel:
    """Fit a model of the usual size; what it was fitted on makes no difference to its speed."""
    dimensions = [default_dimensions(part.kind) for part in feature.parts]
    width = len(feature.describe(street_frames(1)[0]))
    raws = np.random.default_rng(0).random((max(dimensions) + 1, width), np.float32)
    return fit_parts([raws], feature.parts, dimensions=dimensions, standardise=True, plain=False)[0]
