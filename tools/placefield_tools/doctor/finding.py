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
    """One thing that was looked at.

    Attributes:
        subject: what was looked at, in a word or two.
        verdict: good; a warning where something may go slower or be missing; bad where nothing will
            work.
        found: what was seen.
        advice: what to do about it; empty where nothing is to be done.
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
