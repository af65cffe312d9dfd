"""Selection of a recording's topics."""

import logging
from collections.abc import Collection, Mapping

from placefield.errors import SourceError
from placefield.ros.camera_info import RECTIFIED, camera_info_topic, is_rectified

log = logging.getLogger(__name__)

_MOST = 12  # topics that an error names

Types = Mapping[str, str]
"""A recording's topics and the types of their messages."""


def image_topic(name: str, types: Types, kinds: Collection[str], asked: str | None) -> str:
    """Return the topic of images: the one asked for, or the only one.

    Args:
        name: of the recording.
        types: its topics.
        kinds: the types that are images.
        asked: ``--topic``.

    Raises:
        SourceError: there is no such topic, or there are several and none is asked for.
    """
    found = _of_kind(types, kinds)
    if asked is None and len(found) == 1:
        return found[0]
    if asked in found:
        return asked
    if not found:
        raise SourceError(
            f"{name}: has no topic of images of ROS or Foxglove; it holds {_listed(types)}"
        )
    wrong = "" if asked is None else f"--topic {asked}: has no images; "
    raise SourceError(f"{name}: {wrong}choose with --topic one of {', '.join(found)}")


def pose_topic(name: str, types: Types, kinds: Collection[str], asked: str | None) -> str | None:
    """Return the topic of poses: the one asked for, or the only one; None if there is no such one.

    If there are several and none is asked for, no poses are used, which is logged.

    Args:
        name: of the recording.
        types: its topics.
        kinds: the types that are poses.
        asked: ``--odometry-topic``; ``none`` means none.

    Raises:
        SourceError: there is no topic of poses of that name.
    """
    found = _of_kind(types, kinds)
    if asked is None and len(found) > 1:
        log.warning(
            "%s: no poses are used: choose with --odometry-topic one of %s, or none",
            name,
            ", ".join(found),
        )
    if asked is None:
        return found[0] if len(found) == 1 else None
    if asked == "none":
        return None
    if asked in found:
        return asked
    raise SourceError(
        f"{name}: --odometry-topic {asked}: has no poses; "
        f"it holds poses in {', '.join(found) or 'no topic'}"
    )


def camera_topic(
    name: str, types: Types, cameras: Collection[str], kinds: Collection[str], images: str | None
) -> str:
    """Return the topic of the calibration of a camera: that beside its images, or the only one.

    That the only one is not beside the images is logged.

    Args:
        name: of the recording.
        types: its topics.
        cameras: the types that are calibrations.
        kinds: the types that are images.
        images: topic of the camera's images; None: the only one.

    Raises:
        SourceError: there is no such topic, or there are several, or it is not about the images.
    """
    found, every = _of_kind(types, cameras), _of_kind(types, kinds)
    if images is None and len(every) == 1:
        (images,) = every
    if images is not None and is_rectified(images):
        raise SourceError(f"{name}: {images}: {RECTIFIED}")
    beside = None if images is None else camera_info_topic(images)
    if beside in found:
        return beside
    if not found:
        raise SourceError(
            f"{name}: has no topic of CameraInfo; it holds {_listed(types)}; give the calibration "
            "in YAML"
        )
    if len(found) > 1:
        raise SourceError(
            f"{name}: has CameraInfo on {', '.join(found)}; choose with --topic the images beside "
            "one of them, or give the calibration in YAML"
        )
    if images is not None:
        log.warning("%s: the camera of %s is taken to be that of %s", name, images, found[0])
    return found[0]


def _listed(types: Types) -> str:
    every = [f"{topic} ({kind})" for topic, kind in sorted(types.items())]
    more = f" and {len(every) - _MOST} more" if len(every) > _MOST else ""
    return f"{', '.join(every[:_MOST]) or 'nothing'}{more}"


def _of_kind(types: Types, kinds: Collection[str]) -> list[str]:
    return sorted(topic for topic, kind in types.items() if kind in kinds)
