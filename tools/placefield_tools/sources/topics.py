"""Selection of a recording's topics."""

import logging
from collections.abc import Collection, Mapping

from placefield.errors import SourceError

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
        every = [f"{topic} ({kind})" for topic, kind in sorted(types.items())]
        more = f" and {len(every) - _MOST} more" if len(every) > _MOST else ""
        raise SourceError(
            f"{name}: has no topic of images of ROS or Foxglove; "
            f"it holds {', '.join(every[:_MOST]) or 'nothing'}{more}"
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


def _of_kind(types: Types, kinds: Collection[str]) -> list[str]:
    return sorted(topic for topic, kind in types.items() if kind in kinds)
