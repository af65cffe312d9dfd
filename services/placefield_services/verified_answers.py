"""The verified match of a frame: what a verifier answers to a smoothed match.

Comparing the frame with its place takes nearly all the time, and needs no other frame. The answer
also needs the posterior after the frame before.
"""

from typing import NamedTuple

from placefield.bus.messages import SmoothedMessage
from placefield.bus.verified_messages import RelativePoseMessage, Unverified, VerifiedMessage
from placefield.errors import FrameError
from placefield.features.frames import Frame
from placefield.fusion.match import Match
from placefield.verification.verification_stage import ScaledPose, VerificationStage
from placefield_services.verified_frames import Before


class Comparison(NamedTuple):
    """What the comparison of a frame with the place of its match gave.

    Attributes:
        reason: why they were not compared; None if they were.
        inliers: of the two; None if they were not compared.
        relative: the pose of the frame relative to the place; None if it is not known.
    """

    reason: Unverified | None
    inliers: int | None = None
    relative: RelativePoseMessage | None = None


def compare(match: Match, frame: Frame | None, stage: VerificationStage) -> Comparison:
    """Compare a frame with the place of its smoothed match.

    Args:
        match: on a place of the stage's map, or on none.
        frame: None if it is not kept.
        stage: of the map.
    """
    obstacle = stage.obstacle(match)
    if obstacle is not None:
        return Comparison(obstacle)
    if frame is None:
        return Comparison("no_frame")
    if frame.descriptor is not None:
        return Comparison("no_image")
    try:
        query = stage.extract(frame)
    except FrameError:
        return Comparison("unreadable")
    pose = stage.pose(match, query)
    relative = None if pose is None else _relative(pose)
    return Comparison(None, stage.inliers(match, query), relative)


def verified_answer(
    smoothed: SmoothedMessage, compared: Comparison, stage: VerificationStage, before: Before
) -> VerifiedMessage:
    """Return a smoothed match after its verification, or as it was with the reason why.

    Args:
        smoothed: the match.
        compared: its frame with its place.
        stage: of the map.
        before: what is known of the frames before.
    """
    verified = stage.verify(smoothed.match, compared.inliers, *before)
    return VerifiedMessage.of(
        verified.match,
        map=smoothed.map,
        lag=smoothed.lag,
        reason=compared.reason,
        inliers=compared.inliers,
        ratio=verified.ratio,
        posterior=verified.posterior,
        relative=compared.relative,
    )


def _relative(pose: ScaledPose) -> RelativePoseMessage:
    relative, distance = pose.relative, pose.distance
    return RelativePoseMessage.model_validate(
        {
            "rotation": tuple(map(tuple, relative.rotation.tolist())),
            "direction": tuple(relative.direction.tolist()),
            "covariance": tuple(map(tuple, relative.covariance.tolist())),
            "distance_m": None if distance is None else distance.metres,
            "deviation_m": None if distance is None else distance.deviation,
        }
    )
