"""Frames, described once as every method needs them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.baselines.fabmap import Vocabulary, learn_words
from placefield.baselines.seqslam import HEIGHT, WIDTH, seqslam_image
from placefield.errors import FrameError, SourceError
from placefield.features.extract import Feature
from placefield.features.frames import Frame, Pose
from placefield.features.images import grey
from placefield.maps.traverse import ROUTE, DescribedFrame, Traverse, describe_frame, traverse_of
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import tracked
from placefield_tools.evaluate.evaluation import RawFeature, describe_query_with_poses
from placefield_tools.sources import Source

WORDS = 2000
"""Of FAB-MAP's vocabulary."""

Array = NDArray[np.float32]
_Look = tuple[Array, NDArray[np.bool_]]
"""A frame's image for SeqSLAM and words for FAB-MAP."""

_NO_WORDS: NDArray[np.bool_] = np.empty(0, np.bool_)


@dataclass(frozen=True, eq=False)
class Described:
    """n frames, as every method needs them.

    Attributes:
        raws: n raw features, None for a frame that cannot be read.
        images: (n, 32, 64) float32, SeqSLAM's; black for a frame that cannot be read.
        words: (n, W) bool, the words that FAB-MAP sees; none in a frame that cannot be read, and
            W = 0 where there is no vocabulary.
    """

    raws: list[RawFeature]
    images: NDArray[np.float32]
    words: NDArray[np.bool_]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which frames can be read, (n,) bool."""
        return np.array([raw is not None for raw in self.raws], np.bool_)


def learn_vocabulary(source: Source, seed: int) -> Vocabulary:
    """Learn FAB-MAP's words from those of the reference's frames that can be read.

    Raises:
        MapError: no frame has a keypoint.
    """
    with tracked(source, "learning words", source.count) as frames:
        images = map_in_order(_grey_or_none, frames)
        return learn_words((image for image in images if image is not None), WORDS, seed)


def describe_reference(
    source: Source, name: str, feature: Feature, vocabulary: Vocabulary | None
) -> tuple[Traverse, Described]:
    """Describe the reference's frames.

    Raises:
        SourceError: one of them cannot be read.
        MapError: there are none.
    """

    def describe(frame: Frame) -> tuple[DescribedFrame, _Look]:
        try:
            return describe_frame(frame, feature), _look(frame.pixels(), vocabulary)
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
        SourceError: it is live or has no frame that can be read.
    """

    def describe(pixels: NDArray[np.uint8]) -> tuple[Array, _Look]:
        return feature.describe(pixels), _look(pixels, vocabulary)

    unseen = (None, _unseen(vocabulary))
    described, readings, poses = describe_query_with_poses(source, describe)
    both = [one or unseen for one in described]
    return _described([raw for raw, _ in both], [look for _, look in both]), readings, poses


def _described(raws: list[RawFeature], looks: list[_Look]) -> Described:
    images, words = zip(*looks, strict=True)
    return Described(raws, np.stack(images), np.stack(words))


def _look(pixels: NDArray[np.uint8], vocabulary: Vocabulary | None) -> _Look:
    shades = grey(pixels)
    small = seqslam_image(shades)
    return small, _NO_WORDS if vocabulary is None else vocabulary.observe(_rounded(shades))


def _unseen(vocabulary: Vocabulary | None) -> _Look:
    words = 0 if vocabulary is None else len(vocabulary.centres)
    return np.zeros((HEIGHT, WIDTH), np.float32), np.zeros(words, np.bool_)


def _grey_or_none(frame: Frame) -> NDArray[np.uint8] | None:
    try:
        return _rounded(grey(frame.pixels()))
    except FrameError:
        return None


def _rounded(pixels: Array) -> NDArray[np.uint8]:
    return np.rint(pixels).astype(np.uint8)
