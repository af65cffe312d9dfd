"""The stage from a smoothed match and its frame to the match after verification by geometry.

It has no bus and no clock: ``evaluate`` and a verifier both use it.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.features.frames import Frame
from placefield.features.rectification import image_of
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.maps.route_graph import bounds_of
from placefield.verification.extractor import Extractor, extractor_of_places
from placefield.verification.in_plane import Distance
from placefield.verification.inlier_model import Array, InlierModel, ratio_of_posterior
from placefield.verification.likelihood import ratio_of, updated
from placefield.verification.local_features import LocalFeatures
from placefield.verification.plane_pose import Neighbour, related, scaled
from placefield.verification.relative_pose import RelativePose, camera_of
from placefield.verification.two_views import LEAST, count_inliers

_NEXT = 10  # places after a place among which a neighbour is looked for

Obstacle = Literal["unlikely", "no_features"]
"""Why a match cannot be verified, whatever its frame shows: it is of no place or too low a
probability, or its place has too few local features."""


class Verification(NamedTuple):
    """A match after its verification.

    Attributes:
        match: with its new probability, if there are inliers.
        ratio: how much likelier the inliers of the drive so far are if the match is right; None if
            the frame has none.
        posterior: of the drive after this frame, for the next one, see ``InlierModel``; None on a
            map of an earlier version, where each frame counts alone.
    """

    match: Match
    ratio: float | None
    posterior: Array | None


@dataclass(frozen=True, eq=False)
class ScaledPose:
    """The pose of a frame's camera relative to that of a place.

    Attributes:
        relative: rotation, direction and their covariance.
        distance: None if the map has no metres, or too few points have depths.
    """

    relative: RelativePose
    distance: Distance | None


def local_features_of(
    placemap: Map, extractor: Extractor, pixels: NDArray[np.uint8]
) -> LocalFeatures:
    """Return the local features of a frame under the mask of a map, at most as many as of a place.

    Args:
        placemap: with local features.
        extractor: of the map, see ``extractor_of_places``.
        pixels: (H, W) grey or (H, W, 3) BGR, uint8; of the map's view, if it has one.

    Raises:
        FrameError: the image has another aspect ratio than the mask, is no image, or the map's
            network fails on it.
    """
    mask = placemap.model.mask
    return extractor.extract(pixels if mask is None else mask.apply(pixels))


class VerificationStage:
    """Verifies matches of one map; all streams may share it."""

    def __init__(self, placemap: Map, config: Config) -> None:
        """Prepare for a map.

        Args:
            placemap: the map; without local features, no match can be verified.
            config: its verification, and the precision asked for.

        Raises:
            ConfigError: the focal length is given, and the map has a camera's view; or see
                ``extractor_of_places``.
        """
        self._map = placemap
        self._places = places = placemap.local_features
        self._extractor = None if places is None else extractor_of_places(places, config.inference)
        self._model = None
        if places is not None and len(places.by_chance):
            self._model = InlierModel(places.by_chance, places.most)
        self._least = config.verification.least_probability
        self._precision = config.matching.precision
        self._camera = camera_of(placemap.model.view, config.verification.focal)

    def extract(self, frame: Frame) -> LocalFeatures:
        """Return the local features of a frame, see ``local_features_of``; the map has some, too.

        Raises:
            FrameError: see ``image_of`` and ``local_features_of``.
        """
        assert self._extractor is not None
        pixels = image_of(frame, self._map.model.view)
        return local_features_of(self._map, self._extractor, pixels)

    def obstacle(self, match: Match) -> Obstacle | None:
        """Return why a match cannot be verified; None if it can."""
        if match.place < 0 or match.probability is None or match.probability < self._least:
            return "unlikely"
        if self._places is None or len(self._places.of(match.place).points) < LEAST:
            return "no_features"
        return None

    def inliers(self, match: Match, query: LocalFeatures) -> int:
        """Count the inliers of a frame and the place of its match, which has no obstacle.

        Args:
            match: of the frame, on a place of the map.
            query: local features of the frame.
        """
        assert self._places is not None
        return count_inliers(self._places.of(match.place), query, self._map.seed)

    def verify(
        self, match: Match, inliers: int | None, before: Array | None, frames: int = 1
    ) -> Verification:
        """Verify the match of the next frame of a drive.

        Args:
            match: of the frame.
            inliers: of the frame and the place; None if there are none, as of a match with an
                obstacle, which then stays as it is.
            before: the posterior after an earlier frame; None if there is none.
            frames: how many frames earlier that was.
        """
        posterior = None if self._model is None else self._model.predict(before, frames)
        if inliers is None:
            return Verification(match, None, posterior)
        if self._model is None or posterior is None:
            assert self._places is not None
            ratio = ratio_of(self._places.ratios, inliers)
        else:
            posterior = self._model.update(posterior, inliers)
            ratio = ratio_of_posterior(posterior)
        return Verification(self._with_ratio(match, ratio), ratio, posterior)

    def _with_ratio(self, match: Match, ratio: float) -> Match:
        assert match.probability is not None
        probability = updated(match.probability, ratio)
        score = match.score + math.log(ratio)  # log odds, before and after
        known = probability >= self._precision and not match.too_fast
        return replace(match, probability=probability, known=known, score=score)

    def pose(self, match: Match, query: LocalFeatures) -> ScaledPose | None:
        """Return the pose of a frame relative to the place of its match, which has no obstacle.

        None if no focal length is known, or if the images do not determine it.
        """
        if self._camera is None or self._places is None:
            return None
        own, seed = self._places.of(match.place), self._map.seed
        pair = related(own, query, self._camera, seed)
        if pair is None:
            return None
        distance = scaled(pair, own, self._neighbour(match.place), self._camera, seed)
        return ScaledPose(pair[1], distance)

    def _neighbour(self, place: int) -> Neighbour | None:
        """Return the next place of the route that is further along it, with its distance."""
        assert self._places is not None
        travelled = self._map.places.travelled
        if not len(travelled):
            return None
        graph = self._map.graph
        _, end = bounds_of(graph.first, len(travelled))[graph.route_of(place)]
        for later in range(place + 1, min(place + 1 + _NEXT, end)):
            metres = float(travelled[later] - travelled[place])
            if metres > 0:
                return Neighbour(self._places.of(later), metres)
        return None
