"""Which services are silent, which is the slowest, and whether a run can still answer."""

from placefield_tools.common.natural_sort import counted
from placefield_tools.status.service_status import RunStatus

_ANSWERING = ("featurizer", "fuser")  # a run without a channel still answers


def can_answer(status: RunStatus) -> bool:
    """Return whether a new match can come. If not, the shown match is old."""
    gone = (*status.missing, *silent(status))
    return not any(each.startswith(_ANSWERING) for each in gone)


def silent(status: RunStatus) -> tuple[str, ...]:
    """Name the services that are there and have reported, but no longer do: they hang."""
    hanging = {each.service for each in status.services if each.silent and each.counts}
    return tuple(sorted(hanging))


def slowest_in_words(status: RunStatus) -> str:
    """Name the service that is farthest behind; the text is empty if none is more than a frame."""
    slowest = max(status.services, key=lambda each: each.behind or 0, default=None)
    if slowest is None or (slowest.behind or 0) <= 1:
        return ""
    behind = slowest.behind or 0
    seconds = f" ({behind / slowest.rate:.1f} s)" if slowest.rate else ""
    return f"; the slowest is {slowest.service}, {counted(behind, 'frame')}{seconds} behind"
