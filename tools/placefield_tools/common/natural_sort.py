"""Natural sort order of names, and counts with singular and plural."""

import re
from collections.abc import Iterable
from decimal import Decimal

_SUFFIX = re.compile(r"\.[A-Za-z][A-Za-z0-9]*$")
_WHOLE = re.compile(r"([0-9]+)")
_DECIMAL = re.compile(r"((?<![0-9]\.)[0-9]+\.[0-9]+(?![0-9]|\.[0-9])|[0-9]+)")
"""A number with one decimal point, or a whole number, such as each part of 1.2.3."""


def natural_key(name: str, *, decimals: bool = False) -> tuple[list[str | Decimal], str]:
    """Return a sort key that orders numbers by value; the name decides between 1.png and 01.png.

    Args:
        name: of a file, or the like.
        decimals: whether a point between digits is a decimal point; else both sides are numbers.
    """
    stem = _SUFFIX.sub("", name)  # photo.jpg is before photo (1).jpg
    parts = (_DECIMAL if decimals else _WHOLE).split(stem)
    return [Decimal(part) if at % 2 else part for at, part in enumerate(parts)], name


def in_natural_order(names: Iterable[str]) -> list[str]:
    """Return names in natural order: frame2 before frame10, 20.45 before 20.5, 1.9 before 1.10.

    All names together decide whether 20.45 is a decimal number or two numbers. The difference
    matters only if the fractions differ in length. Decimal numbers without trailing zeros never end
    in a zero, and counters that reach ten do.
    """
    names = list(names)
    numbers = (number for name in names for number in _DECIMAL.findall(name))
    fractions = [number.partition(".")[2] for number in numbers]
    are_decimals = not any(len(each) > 1 and each.endswith("0") for each in fractions)
    return sorted(names, key=lambda name: natural_key(name, decimals=are_decimals))


def counted(count: int, name: str) -> str:
    """Return a count with its noun: 1 frame, 2 frames."""
    return f"{count} {name}" if count == 1 else f"{count} {name}s"
