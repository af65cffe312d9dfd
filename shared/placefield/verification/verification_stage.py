"""The stage from a smoothed match and its frame to the match after verification by geometry.

It has no bus and no clock: ``evaluate`` and a verifier both use it.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.features.frames import Frame
from placefield.features.rectification import image_of
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.maps.route_graph import bounds_of
from placefield.verification.extracting import extract
from placefield.verification.in_plane import Distance
from placefield.verification.local_features import LocalFeatures
from placefield.verification.plane_pose import Neighbour, related, scaled
from placefield.verification.relative_pose import RelativePose, camera_of
from placefield.verification.two_views import LEAST
from placefield.verification.verifying import Verification, verify, with_evidence

_NEXT = 10  # places after a place among which a neighbour is looked for

Obstacle = Literal["unlikely", "no_features"]
"""Why a match cannot be verified, whatever its frame shows: it is of no place or too low a
probability, or its place has too few local features."""


@dataclass(frozen=True, eq=False)
class ScaledPose:
    """The pose of a frame's camera relative to that of a place.

    Attributes:
        relative: rotation, direction and their covariance.
        distance: None if the map has no metres, or too few points have depths.
    """

    relative: RelativePose
    distance: Distance | None


def local_features_of(placemap: Map, pixels: NDArray[np.uint8]) -> LocalFeatures:
    """Return the local features of a frame under the mask of a map, at most as many as of a place.

    Args:
        placemap: with local features.
        pixels: (H, W) grey or (H, W, 3) BGR, uint8; of the map's view, if it has one.

    Raises:
        FrameError: the image has another aspect ratio than the mask, or is no image.
    """
    assert placemap.local_features is not None
    mask = placemap.model.mask
    return extract(pixels if mask is None else mask.apply(pixels), placemap.local_features.most)


class VerificationStage:
    """Verifies matches of one map; all streams may share it."""

    def __init__(self, placemap: Map, config: Config) -> None:
        """Prepare for a map.

        Args:
            placemap: the map; without local features, no match can be verified.
            config: its verification, and the precision asked for.

        Raises:
            ConfigError: the focal length is given, and the map has a camera's view.
        """
        self._map = placemap
        self._places = placemap.local_features
        self._least = config.verification.least_probability
        self._precision = config.matching.precision
        self._camera = camera_of(placemap.model.view, config.verification.focal)

    def extract(self, frame: Frame) -> LocalFeatures:
        """Return the local features of a frame, see ``local_features_of``.

        Raises:
            FrameError: see ``image_of`` and ``local_features_of``.
        """
        return local_features_of(self._map, image_of(frame, self._map.model.view))

    def obstacle(self, match: Match) -> Obstacle | None:
        """Return why a match cannot be verified; None if it can."""
        if match.place < 0 or match.probability is None or match.probability < self._least:
            return "unlikely"
        if self._places is None or len(self._places.of(match.place).points) < LEAST:
            return "no_features"
        return None

    def verify(self, match: Match, query: LocalFeatures) -> tuple[Match, Verification]:
        """Return a match, which must have no obstacle, after its verification, and this.

        Args:
            match: of the frame, on a place of the map.
            query: local features of the frame.
        """
        assert self._places is not None
        assert match.probability is not None
        found = verify(self._places, match.place, match.probability, query, self._map.seed)
        return with_evidence(match, found, self._precision), found

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
