"""Builds maps from frames of a program: what ``from placefield import build_map`` gives."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

from threadpoolctl import threadpool_limits

from placefield.config import Config
from placefield.errors import MapError, SourceError
from placefield.features.extract import Feature, feature_of
from placefield.features.frames import Frame
from placefield.features.images import Image, load
from placefield.features.rectification import view_of
from placefield.maps import build
from placefield.maps.map import Map
from placefield.maps.same_route import align_traverses
from placefield.maps.traverse import Traverse, describe_frame, traverse_of
from placefield.verification.extractor import Extractor, extractor_of

_DEFAULTS = Config()


def build_map(*traverses: Iterable[Image | Frame], config: Config = _DEFAULTS) -> Map:
    """Build a map from the frames of one or more traverses of a route, in the order of travel.

    Args:
        traverses: the first gives the places. The others, of any length and speed, show the route
            in other light, and metrics are learned from them. Their frames are aligned to the
            places; a frame that shows no place is left out. A ``Frame`` has its own stamp, pose and
            odometry; an image alone is stamped one second after the one before. If the first frame
            has the calibration of its camera, all frames are rectified to this camera's view.
        config: of features, scales, metric and seed.

    Raises:
        SourceError: a file cannot be read, or is something else.
        FrameError: an image does not decode, pixels are of another shape or dtype, or the camera of
            a frame does not fit the first one's view.
        MapError: the frames do not make a map: too few, traverses that differ in their route, a
            pose that is not finite, or odometry that goes back.
        ConfigError: a network cannot be read or run, or the first camera has no view.
    """
    if not traverses:
        raise MapError("build_map() needs the frames of a traverse")
    names = [f"traverse {number}" for number in range(len(traverses))]
    first, *others = map(_frames, names, traverses)
    begin = list(islice(first, 1))
    calibration = begin[0].calibration if begin else None
    view = None if calibration is None else view_of(calibration)
    feature = replace(feature_of(config.features.kind, config.inference), view=view)
    extractor = extractor_of(config.build, config.inference)
    described = [
        _described(name, frames, feature, extractor)
        for name, frames in zip(names, (chain(begin, first), *others), strict=True)
    ]
    with threadpool_limits(1):  # the number of threads changes the last bits
        aligned = align_traverses(described, config.features.kind)
        built = build.build_map(aligned, config, parts=feature.parts)
    return replace(built, model=replace(built.model, view=view))


def _described(
    name: str, frames: Iterable[Frame], feature: Feature, extractor: Extractor | None
) -> Traverse:
    described = traverse_of(name, (describe_frame(frame, feature, extractor) for frame in frames))
    return described if extractor is None else replace(described, local_network=extractor.onnx)


def _frames(name: str, images: Iterable[Image | Frame]) -> Iterator[Frame]:
    if isinstance(images, (bytes, str, Path)) or getattr(images, "ndim", 4) < 4:
        raise SourceError(f"{name}: is one image; give build_map() a list of them")
    return (_frame(name, index, image) for index, image in enumerate(images))


def _frame(name: str, index: int, image: Image | Frame) -> Frame:
    if isinstance(image, Frame):
        return replace(image, index=index)
    called = str(image) if isinstance(image, Path) else f"{name}, frame {index}"
    return Frame(index, index * 10**9, called, load(image))
