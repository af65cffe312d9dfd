"""Picture of how several ways of cutting the route group the frames of one stretch."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from placefield_tools.plots import style
from placefield_tools.plots.frame_pictures import (
    PictureOf,
    draw_picture,
    height_per_width,
    read_pictures,
)
from placefield_tools.plots.runs import ChannelSegments, Runs, runs_of

_WIDTH = 11.0
_COLUMNS = 12  # frames in a line

# In widths of a frame and its border, as is everything in the axes.
_BORDER = 0.06
_GAP = 0.03  # half of the gap between two groups
_ABOVE = 0.24
_BELOW = 0.24


@dataclass(frozen=True, slots=True)
class GroupPiece:
    """What of one group stands in one line.

    Attributes:
        run: index of the group among the channel's runs.
        first: first place of the piece.
        last: last place of the piece.
        begins: the group begins with it.
        ends: the group ends with it.

    """

    run: int
    first: int
    last: int
    begins: bool
    ends: bool


def plot_groups(
    path: Path,
    rows: Mapping[str, ChannelSegments],
    first: int,
    picture_of: PictureOf,
    count: int = 24,
    title: str | None = None,
) -> None:
    """Draw the same consecutive frames once for each cut, those of a group on one band.

    An active group's band is red, an inactive one's is blue, and between two groups is a gap. Over
    a group's beginning stands its length, and before that its label if it is active. Where a group
    goes on in the next line, the band runs to the edge. After the AMS paper's figures 14 and 15.

    Args:
        path: the PNG file to write.
        rows: the cuts by name, from top to bottom, at least one.
        first: first place of the stretch.
        picture_of: gives the frame of a place, (H, W) grey or (H, W, 3) BGR, uint8.
        count: how many places, at least 1; twelve fill a line.
        title: printed above.

    Raises:
        OSError: the file cannot be written.
        ValueError: there is no cut, one has not all of the places, or a frame is not a picture.

    """
    if not rows:
        raise ValueError("there is no cut of the route to draw")
    runs = [runs_of(channel) for channel in rows.values()]
    for name, channel in rows.items():
        if count < 1 or first < 0 or first + count > len(channel.label):
            raise ValueError(
                f"{name} has places 0 to {len(channel.label) - 1}, so {count} from {first} on "
                "cannot be drawn"
            )
    pictures = read_pictures(picture_of, range(first, first + count))
    ratio = height_per_width(pictures.values())
    line_height = _ABOVE + (1 - 2 * _BORDER) * ratio + 2 * _BORDER + _BELOW
    height = line_height * -(-count // _COLUMNS)

    inches = (_WIDTH - 0.2) / _COLUMNS
    figure = style.new_figure(_WIDTH, 0.4 + (height * inches + 0.35) * len(rows), title)
    panels = figure.subplots(len(rows), 1, squeeze=False)[:, 0]
    for axes, name, run in zip(panels, rows, runs, strict=True):
        for line, begin in enumerate(range(first, first + count, _COLUMNS)):
            end = min(begin + _COLUMNS, first + count)
            top = line * line_height + _ABOVE
            for piece in pieces(run, begin, end):
                _draw_band(axes, run, piece, begin, top, ratio)
            for column, place in enumerate(range(begin, end)):
                draw_picture(
                    axes, pictures[place], column + _BORDER, top + _BORDER, 1 - 2 * _BORDER
                )
                axes.text(
                    column + 0.5,
                    top + line_height - _ABOVE - _BELOW + 0.03,
                    str(place),
                    ha="center",
                    va="top",
                    fontsize=7,
                    color=style.MUTED,
                )
        axes.set_title(name, loc="left", fontsize=11, fontweight="bold", color=style.INK, pad=2)
        axes.set(xlim=(0, _COLUMNS), ylim=(height, 0), aspect="equal", anchor="NW")
        axes.set_axis_off()
    style.save(figure, path)


def pieces(runs: Runs, begin: int, end: int) -> Iterator[GroupPiece]:
    """Give what of each group lies in a line, in route order.

    Args:
        runs: of the channel.
        begin: first place of the line.
        end: the place after its last.

    """
    for run, (start, length) in enumerate(zip(runs.start, runs.length, strict=True)):
        after = int(start + length)
        if start < end and after > begin:
            yield GroupPiece(
                run,
                first=max(int(start), begin),
                last=min(after, end) - 1,
                begins=bool(start >= begin),
                ends=after <= end,
            )


def _draw_band(
    axes: Axes, runs: Runs, piece: GroupPiece, begin: int, top: float, ratio: float
) -> None:
    left = piece.first - begin + (_GAP if piece.begins else 0)
    right = piece.last + 1 - begin - (_GAP if piece.ends else 0)
    height = (1 - 2 * _BORDER) * ratio + 2 * _BORDER
    colour = runs.colours[piece.run]
    axes.add_patch(
        Rectangle((left, top), right - left, height, facecolor=colour, linewidth=0, zorder=1)
    )
    length = runs.length[piece.run]
    # Short, for over a group of one frame there is no room for more.
    words = [str(runs.label[piece.run])] if runs.active[piece.run] else []
    words.append(f"{length} frame{'s' if length > 1 else ''}" if piece.begins else "…")
    axes.text(
        left,
        top - 0.04,
        ": ".join(words),
        fontsize=8,
        color=style.INK if runs.active[piece.run] else style.MUTED,
    )
