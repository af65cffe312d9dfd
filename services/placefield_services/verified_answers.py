"""The verified match of a frame: what a verifier answers to a smoothed match."""

from placefield.bus.messages import SmoothedMessage
from placefield.bus.verified_messages import RelativePoseMessage, Unverified, VerifiedMessage
from placefield.errors import FrameError
from placefield.features.frames import Frame
from placefield.verification.verification_stage import ScaledPose, VerificationStage


def verified_answer(
    smoothed: SmoothedMessage, frame: Frame | None, stage: VerificationStage
) -> VerifiedMessage:
    """Return a smoothed match after its verification, or as it was with the reason why.

    Args:
        smoothed: of a place of the stage's map, or of none.
        frame: None if it is not kept.
        stage: of the map.
    """
    obstacle = stage.obstacle(smoothed.match)
    if obstacle is not None:
        return unverified_answer(smoothed, obstacle)
    if frame is None:
        return unverified_answer(smoothed, "no_frame")
    if frame.descriptor is not None:
        return unverified_answer(smoothed, "no_image")
    try:
        query = stage.extract(frame)
    except FrameError:
        return unverified_answer(smoothed, "unreadable")
    match, found = stage.verify(smoothed.match, query)
    pose = stage.pose(match, query)
    return VerifiedMessage.of(
        match,
        map=smoothed.map,
        lag=smoothed.lag,
        inliers=found.inliers,
        ratio=found.ratio,
        relative=None if pose is None else _relative(pose),
    )


def unverified_answer(smoothed: SmoothedMessage, reason: Unverified) -> VerifiedMessage:
    """Return a smoothed match as it was, with the reason why it was not verified."""
    return VerifiedMessage.of(smoothed.match, map=smoothed.map, lag=smoothed.lag, reason=reason)


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
