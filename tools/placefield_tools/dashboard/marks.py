"""The marks of verdicts: they differ in shape, so that they can be told apart without colours."""

from collections.abc import Iterable

_DOT = "h0"  # of a round pen
_CROSS = "m-1.2 -2.4l2.4 4.8m0 -4.8l-2.4 4.8"
_LAYERS = {"likely": ("under", "over"), "unknown": ("under", "over")}

KEY = "".join(f'<span class="mark {kind}">{kind}</span>' for kind in ("known", "likely", "unknown"))
"""The three marks with their names, as HTML."""


def marks_drawing(points: Iterable[tuple[float, float, str]]) -> str:
    """Draw a mark at each point: a dot, a ring if it is likely, a cross if it is unknown.

    A ring is a dot upon a larger one, and a cross has an edge, so that both are seen on a picture.

    Args:
        points: to the right, downwards, and the class in the page's style: the kind of the verdict.
    """
    drawn: dict[str, str] = {}
    for x, y, kind in points:
        shape = _CROSS if kind == "unknown" else _DOT
        drawn[kind] = f"{drawn.get(kind, '')}M{x:g} {y:.2f}{shape}"
    return "".join(
        f'<path class="{kind} {layer}" d="{path}"/>'
        if layer
        else f'<path class="{kind}" d="{path}"/>'
        for kind, path in drawn.items()
        for layer in _LAYERS.get(kind, ("",))
    )
