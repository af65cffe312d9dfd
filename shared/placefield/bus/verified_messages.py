"""The message of verifiers: a smoothed match after its verification by geometry."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from placefield.bus.message import Strict
from placefield.bus.messages import SmoothedMessage
from placefield.bus.wire import NumberVector
from placefield.verification.inlier_model import STATES

Unverified = Literal["unlikely", "no_features", "no_frame", "no_image", "unreadable", "failed"]
"""Why a match was not verified: its probability is too low, or it has none; its place has too few
local features; its frame is not kept, is a descriptor, or cannot be read; a defect."""

WORDS: dict[Unverified, str] = {
    "unlikely": "its probability is too low",
    "no_features": "its place has too few local features",
    "no_frame": "its frame is not kept",
    "no_image": "its frame is a descriptor",
    "unreadable": "its frame cannot be read",
    "failed": "a defect; see the log of the verifiers",
}
"""The reasons in words."""

Positive = Annotated[FiniteFloat, Field(gt=0)]
_TOLERANCE = 1e-6  # of a rotation, a direction and a sum of probabilities

Cosine = Annotated[FiniteFloat, Field(ge=-1.001, le=1.001)]  # but for rounding
Row = tuple[Cosine, Cosine, Cosine]
Five = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]


class RelativePoseMessage(Strict):
    """The pose of a frame's camera relative to that of its place, in the axes of the place's.

    Attributes:
        rotation: 3 rows of 3; the columns are the axes of the frame's camera.
        direction: from the place's camera to the frame's, of length 1.
        covariance: 5 rows of 5, radians², see ``RelativePose``.
        distance_m: metres; None if the scale is not known.
        deviation_m: standard deviation of the distance, metres.
    """

    rotation: tuple[Row, Row, Row]
    direction: Row
    covariance: tuple[Five, Five, Five, Five, Five]
    distance_m: Positive | None = None
    deviation_m: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        rotation, direction = np.array(self.rotation), np.array(self.direction)
        is_orthonormal = np.abs(rotation @ rotation.T - np.eye(3)).max() < _TOLERANCE
        if not (is_orthonormal and np.linalg.det(rotation) > 0):
            raise PydanticCustomError("rotation", "the rotation is not orthonormal")
        if abs(np.linalg.norm(direction) - 1) > _TOLERANCE:
            raise PydanticCustomError("direction", "the direction is not of length 1")
        if (self.distance_m is None) != (self.deviation_m is None):
            raise PydanticCustomError("distance", "distance and deviation come together")
        return self


class VerifiedMessage(SmoothedMessage):
    """A smoothed match after its verification: ``probability``, ``score`` and ``known`` are new.

    A match that was not verified is as it was, and says the reason.

    Attributes:
        reason: why it was not verified; None if it was.
        inliers: how many correspondences of frame and place fit one epipolar geometry.
        ratio: how much likelier the inliers of the drive so far are if the match is right.
        posterior: (STATES,) float64, of the drive after this frame, so that any verifier can verify
            the next one, see ``InlierModel``; None on a map of an earlier version.
        relative: the pose of the frame relative to the place; None if no focal length is known,
            or if the images do not determine it.
    """

    reason: Unverified | None = None
    inliers: int | None = Field(None, ge=0, lt=2**31)
    ratio: Positive | None = None
    posterior: NumberVector | None = None
    relative: RelativePoseMessage | None = None

    @model_validator(mode="after")
    def _check_reason(self) -> Self:
        found = self.inliers, self.ratio
        if any((value is None) != (self.reason is not None) for value in found):
            raise PydanticCustomError("reason", "there are inliers and a ratio, or a reason")
        if self.reason is not None and self.relative is not None:
            raise PydanticCustomError("reason", "a pose of a match that was not verified")
        return self

    @model_validator(mode="after")
    def _check_posterior(self) -> Self:
        posterior = self.posterior
        if posterior is None:
            return self
        if posterior.size != STATES or posterior.min() < 0:
            raise PydanticCustomError("posterior", f"the posterior is not {STATES} probabilities")
        if not abs(posterior.sum() - 1) <= _TOLERANCE:
            raise PydanticCustomError("posterior", "the posterior does not sum to 1")
        return self
