"""Parsing of stamps that are written in seconds."""

from decimal import Decimal


def nanoseconds(seconds: str) -> int:
    """Return a stamp in nanoseconds, exactly (by Decimal, because a float would round it).

    Raises:
        ValueError: the text is no valid number of seconds.
    """
    try:
        exact = Decimal(seconds) * 1_000_000_000
        stamp_ns = round(exact) if 0 <= exact < 2**63 else -1  # 1e99999 would take long to round
    except (ArithmeticError, ValueError):
        stamp_ns = -1
    if not 0 <= stamp_ns < 2**63:
        raise ValueError(f"the stamp {seconds!r} must be a number of seconds from 0 up")
    return stamp_ns
