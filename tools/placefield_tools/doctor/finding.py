"""What an examination finds."""

from dataclasses import dataclass
from enum import StrEnum


class Health(StrEnum):
    """How grave a finding is."""

    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes:
        subject: what was checked, in a word or two.
        verdict: good; warning if something may be slow or missing; bad if nothing will work.
        found: what the check found.
        advice: what to do; empty if there is nothing to do.
    """

    subject: str
    verdict: Health
    found: str
    advice: str = ""


def good(subject: str, found: str) -> Finding:
    """Find nothing wrong."""
    return Finding(subject, Health.GOOD, found)


def warning(subject: str, found: str, advice: str) -> Finding:
    """Find something that can be lived with."""
    return Finding(subject, Health.WARNING, found, advice)


def bad(subject: str, found: str, advice: str) -> Finding:
    """Find something that must be mended."""
    return Finding(subject, Health.BAD, found, advice)
