"""What a run lacks, in words, and whether it can answer at all."""

from placefield_tools.status.service_status import RunStanding

_ANSWERING = ("featurizer", "fuser")  # without a channel there still are answers


def can_answer(standing: RunStanding) -> bool:
    """Return whether a match may still come: one that is shown is else an old one."""
    return not any(each.startswith(_ANSWERING) for each in standing.missing)


def lacking_words(standing: RunStanding) -> str:
    """Say which services are missing; nothing where none is."""
    return f"missing: {'; '.join(standing.missing)}" if standing.missing else ""
