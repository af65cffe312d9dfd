"""Stamps that a person writes in seconds."""

from decimal import Decimal


def nanoseconds(seconds: str) -> int:
    """Return a stamp in ns, by way of Decimal: as float, an epoch's ns would be rounded.

    Raises:
        ValueError: it is no number of seconds that a stamp can be.
    """
    try:
        stamp_ns = round(Decimal(seconds) * 1_000_000_000)
    except (ArithmeticError, ValueError):
        stamp_ns = -1
    if not 0 <= stamp_ns < 2**63:
        raise ValueError(f"the stamp {seconds!r} must be a number of seconds from 0 up")
    return stamp_ns
