"""How people order and count things."""

import re


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Order numbers in a name by value; the name itself settles 1.png and 01.png."""
    parts = re.split(r"([0-9]+)", name)
    return [int(part) if at % 2 else part for at, part in enumerate(parts)], name


def counted(count: int, name: str) -> str:
    """Say how many there are of what has this name: 1 frame, 2 frames."""
    return f"{count} {name}" if count == 1 else f"{count} {name}s"
