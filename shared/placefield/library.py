"""Builds maps from frames of a program: what ``from placefield import build_map`` gives."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from placefield.config import Config
from placefield.errors import MapError, SourceError
from placefield.features.extract import Feature, feature_of
from placefield.features.frames import Frame
from placefield.features.images import Image, load
from placefield.maps import build
from placefield.maps.map import Map
from placefield.maps.same_route import align_traverses
from placefield.maps.traverse import Traverse, describe_frame, traverse_of

_DEFAULTS = Config()


def build_map(*traverses: Iterable[Image | Frame], config: Config = _DEFAULTS) -> Map:
    """Build a map from the frames of one or more traverses of a route, in the order of travel.

    Args:
        traverses: the first gives the places. The others, of any length and speed, show the route
            in other light, and metrics are learned from them. Their frames are aligned to the
            places; a frame that shows no place is left out. A ``Frame`` has its own stamp, pose and
            odometry; an image alone is stamped one second after the one before.
        config: of features, scales, metric and seed.

    Raises:
        SourceError: a file cannot be read, or is something else.
        FrameError: an image does not decode, or pixels are of another shape or dtype.
        MapError: the frames do not make a map: too few, traverses that differ in their route, a
            pose that is not finite, or odometry that goes back.
        ConfigError: the features' network cannot be read.
    """
    if not traverses:
        raise MapError("build_map() needs the frames of a traverse")
    feature = feature_of(config.features.kind, config.inference)
    described = [
        _described(f"traverse {number}", traverse, feature, config.build.local_features)
        for number, traverse in enumerate(traverses)
    ]
    with threadpool_limits(1):  # the number of threads changes the last bits
        aligned = align_traverses(described, config.features.kind)
        return build.build_map(aligned, config, parts=feature.parts)


def _described(
    name: str, images: Iterable[Image | Frame], feature: Feature, local_features: int
) -> Traverse:
    if isinstance(images, (bytes, str, Path)) or getattr(images, "ndim", 4) < 4:
        raise SourceError(f"{name}: is one image; give build_map() a list of them")
    frames = (_frame(name, index, image) for index, image in enumerate(images))
    return traverse_of(name, (describe_frame(frame, feature, local_features) for frame in frames))


def _frame(name: str, index: int, image: Image | Frame) -> Frame:
    if isinstance(image, Frame):
        return replace(image, index=index)
    called = str(image) if isinstance(image, Path) else f"{name}, frame {index}"
    return Frame(index, index * 10**9, called, load(image))
