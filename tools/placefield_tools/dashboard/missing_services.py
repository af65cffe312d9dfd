"""Which services a run misses, in words, and whether it can still answer."""

from placefield_tools.status.service_status import RunStatus

_ANSWERING = ("featurizer", "fuser")  # a run without a channel still answers


def can_answer(status: RunStatus) -> bool:
    """Return whether a new match can come. If not, the shown match is old."""
    return not any(each.startswith(_ANSWERING) for each in status.missing)


def missing_in_words(status: RunStatus) -> str:
    """Name the missing services; the text is empty if none is missing."""
    return f"missing: {'; '.join(status.missing)}" if status.missing else ""
