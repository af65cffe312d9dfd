"""The order in which people count names."""

import re


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Order numbers in a name by value; the name itself settles 1.png and 01.png."""
    parts = re.split(r"([0-9]+)", name)
    return [int(part) if at % 2 else part for at, part in enumerate(parts)], name
