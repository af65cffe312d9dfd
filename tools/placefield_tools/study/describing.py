"""Describes frames once for all methods."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.baselines.fabmap import Vocabulary, learn_words
from placefield.baselines.seqslam import HEIGHT, WIDTH, seqslam_image
from placefield.errors import FrameError, SourceError
from placefield.features.calibration import View
from placefield.features.extract import Feature
from placefield.features.frames import Frame, Pose
from placefield.features.images import grey
from placefield.features.rectification import image_of
from placefield.maps.traverse import ROUTE, DescribedFrame, Traverse, describe_frame, traverse_of
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import tracked
from placefield_tools.evaluate.drive_matching import RawFeature
from placefield_tools.evaluate.evaluation import describe_query
from placefield_tools.sources import Source

WORDS = 2000
"""Of FAB-MAP's vocabulary."""

Array = NDArray[np.float32]
_Observation = tuple[Array, NDArray[np.bool_]]
"""A frame's image for SeqSLAM and words for FAB-MAP."""

_NO_WORDS: NDArray[np.bool_] = np.empty(0, np.bool_)
_NO_OBSERVATION: _Observation = (np.empty((0, 0), np.float32), _NO_WORDS)
"""That of a frame without an image."""


@dataclass(frozen=True, eq=False)
class Described:
    """The descriptions of n frames for all methods.

    Attributes:
        raws: n raw features, None for a frame that cannot be read.
        images: (n, 32, 64) float32, SeqSLAM's; black for a frame that cannot be read. (n, 0, 0) if
            the frames are descriptors.
        words: (n, W) bool, the words that FAB-MAP sees; none in a frame that cannot be read, and
            W = 0 where there is no vocabulary.
    """

    raws: list[RawFeature]
    images: NDArray[np.float32]
    words: NDArray[np.bool_]

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Whether each frame is readable, (n,) bool."""
        return np.array([raw is not None for raw in self.raws], np.bool_)


def learn_vocabulary(source: Source, view: View | None, seed: int) -> Vocabulary:
    """Learn FAB-MAP's words from the readable frames of the reference.

    Args:
        source: of the frames.
        view: that they are rectified to; None: they are used as they are.
        seed: of the clustering.

    Raises:
        MapError: no frame has a keypoint.
    """
    with tracked(source, "learning words", source.count) as frames:
        images = map_in_order(partial(_grey_or_none, view), frames)
        return learn_words((image for image in images if image is not None), WORDS, seed)


def describe_reference(
    source: Source, name: str, feature: Feature, vocabulary: Vocabulary | None
) -> tuple[Traverse, Described]:
    """Describe the reference's frames.

    Raises:
        SourceError: a frame cannot be read.
        MapError: there are no frames.
    """

    def describe(frame: Frame) -> tuple[DescribedFrame, _Observation]:
        try:
            return describe_frame(frame, feature), _look(frame, feature.view, vocabulary)
        except FrameError as error:
            raise SourceError(f"{error}; a study's reference needs every frame") from None

    with tracked(source, f"describing {Path(name).name}", source.count) as frames:
        both = list(map_in_order(describe, frames))
    traverse = traverse_of(
        name,
        (described for described, _ in both),
        source.origin.frame if source.origin else ROUTE,
        stamped=source.stamped,
    )
    return traverse, _described([*traverse.raw], [look for _, look in both])


def describe_query_frames(
    source: Source, feature: Feature, vocabulary: Vocabulary | None
) -> tuple[Described, list[float | None], list[Pose | None]]:
    """Describe a query's frames; with them come odometry and pose of each, None where not known.

    Raises:
        SourceError: the query is live, or has no readable frame.
    """

    def describe(frame: Frame) -> tuple[Array, _Observation]:
        return feature.of_frame(frame), _look(frame, feature.view, vocabulary)

    is_image = source.dimensions is None
    missing = (None, _missing_observation(vocabulary) if is_image else _NO_OBSERVATION)
    described, readings, poses = describe_query(source, describe)
    both = [one or missing for one in described]
    return _described([raw for raw, _ in both], [look for _, look in both]), readings, poses


def _described(raws: list[RawFeature], observations: list[_Observation]) -> Described:
    images, words = zip(*observations, strict=True)
    return Described(raws, np.stack(images), np.stack(words))


def _look(frame: Frame, view: View | None, vocabulary: Vocabulary | None) -> _Observation:
    if frame.descriptor is not None:
        return _NO_OBSERVATION
    shades = grey(image_of(frame, view))
    small = seqslam_image(shades)
    return small, _NO_WORDS if vocabulary is None else vocabulary.observe(_rounded(shades))


def _missing_observation(vocabulary: Vocabulary | None) -> _Observation:
    words = 0 if vocabulary is None else len(vocabulary.centres)
    return np.zeros((HEIGHT, WIDTH), np.float32), np.zeros(words, np.bool_)


def _grey_or_none(view: View | None, frame: Frame) -> NDArray[np.uint8] | None:
    try:
        return _rounded(grey(image_of(frame, view)))
    except FrameError:
        return None


def _rounded(pixels: Array) -> NDArray[np.uint8]:
    return np.rint(pixels).astype(np.uint8)
