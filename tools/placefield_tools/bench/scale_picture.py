"""What a frame costs, by the size of the map, as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from placefield_tools.plots.style import INK, RIGHT, WRONG, new_figure, save, tidy


def draw_scale(path: Path, numbers: Mapping[str, float], sizes: Sequence[int]) -> None:
    """Draw time and memory of maps of these sizes from what ``bench scale`` measured, as a PNG."""
    figure = new_figure(8, 3.4, "A frame in maps of a thousand to a million places")
    time, memory = figure.subplots(1, 2)
    time.loglog(sizes, [numbers[f"frame_ms_{size}"] for size in sizes], "o-", color=RIGHT)
    time.axhline(100, color=WRONG, linestyle="--", linewidth=1)
    time.text(sizes[0], 110, "10 frames per second", color=INK, fontsize=9)
    time.set_ylabel("milliseconds per frame")
    memory.loglog(sizes, [numbers[f"resident_gb_{size}"] for size in sizes], "o-", color=RIGHT)
    memory.set_ylabel("resident memory of all services, GB")
    for axes in (time, memory):
        axes.set_xlabel("places")
        tidy(axes)
    save(figure, path)
