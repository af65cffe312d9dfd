"""The aspect ratio of images."""

_TOLERANCE = 0.01  # most relative difference


def have_one_aspect(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Return whether two sizes, height and width each, count as of the same aspect ratio."""
    (height, width), (rows, columns) = one, other
    return abs(width * rows / (height * columns) - 1) <= _TOLERANCE
