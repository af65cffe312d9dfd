"""One channel's cut of the route into runs of places, and the bar that shows it."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

# Two tones in turn, so that neighbouring active segments can be told apart.
ACTIVE = ("#b2182b", "#ef8a73")
INACTIVE = "#a9c3de"


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSegments:
    """How one channel cut the reference traverse.

    Attributes:
        name: what the channel is called.
        fuzzifier: m of its fuzzy c-means.
        label: of each place, (K,) int; a segment is a run of one label.
        active: the place lies in an active segment, (K,) bool.

    """

    name: str
    fuzzifier: float
    label: NDArray[np.integer]
    active: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """The runs of places that have one label and are all active or all inactive, in route order.

    Attributes:
        start: first place of each run, (R,) int.
        length: in places, (R,) int.
        label: of its places, (R,) int.
        active: the run is an active segment, (R,) bool.

    """

    start: NDArray[np.intp]
    length: NDArray[np.intp]
    label: NDArray[np.integer]
    active: NDArray[np.bool_]

    @property
    def scales(self) -> NDArray[np.intp]:
        """Length of each active segment, (S,) int."""
        return self.length[self.active]

    @property
    def colours(self) -> list[str]:
        """Colour of each run: active ones red, in two tones in turn, inactive ones blue."""
        turn = np.cumsum(self.active) % 2
        return [ACTIVE[t] if a else INACTIVE for t, a in zip(turn, self.active, strict=True)]


def runs_of(channel: ChannelSegments) -> Runs:
    """Find the runs of a channel.

    Raises:
        ValueError: the channel has no place, or not as many labels as it has active flags.

    """
    label, active = channel.label, channel.active
    if label.ndim != 1 or label.shape != active.shape or not label.size:
        raise ValueError(
            f"{channel.name} has labels of shape {label.shape} and active flags of shape "
            f"{active.shape}: both have to be one for each place, of one place at least"
        )
    changes = (label[1:] != label[:-1]) | (active[1:] != active[:-1])
    start = np.flatnonzero(np.concatenate([[True], changes]))
    return Runs(start, np.diff(start, append=len(label)), label[start], active[start])


def summary(channel: ChannelSegments, runs: Runs) -> str:
    """Say in a line what the channel is called and how it cut the route."""
    scales = f", scales {runs.scales.min()} to {runs.scales.max()}" if runs.scales.size else ""
    return (
        f"{channel.name}   fuzzifier {channel.fuzzifier:.2f}   {runs.scales.size} active segments, "
        f"{np.mean(channel.active):.0%} of places{scales}"
    )


def draw_bar(axes: Axes, runs: Runs) -> None:
    """Fill the axes with the route as a bar, place k from k to k + 1."""
    axes.bar(runs.start, 1, runs.length, color=runs.colours, align="edge", antialiased=False)
    axes.set_ylim(0, 1)
    axes.set_axis_off()
