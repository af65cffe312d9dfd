"""Which services a run misses, in words, and whether it can still answer."""

from placefield_tools.common.natural_sort import counted
from placefield_tools.status.service_status import RunStatus

_ANSWERING = ("featurizer", "fuser")  # a run without a channel still answers


def can_answer(status: RunStatus) -> bool:
    """Return whether a new match can come. If not, the shown match is old."""
    return not any(each.startswith(_ANSWERING) for each in status.missing)


def missing_in_words(status: RunStatus) -> str:
    """Name the missing services; the text is empty if none is missing."""
    return f"missing: {'; '.join(status.missing)}" if status.missing else ""


def slowest_in_words(status: RunStatus) -> str:
    """Name the service that is farthest behind; the text is empty if none is."""
    behind = [each for each in status.services if each.behind]
    if not behind:
        return ""
    slowest = max(behind, key=lambda each: each.behind or 0)
    return f"; the slowest is {slowest.service}, {counted(slowest.behind or 0, 'frame')} behind"
