"""What the paper's experiments find."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from placefield.evaluation.protocols import Protocol
from placefield.maps.map import Map
from placefield_tools.evaluate.judging import Judged
from placefield_tools.evaluate.truth_source import TruthSource
from placefield_tools.study.neighbours import Learned
from placefield_tools.study.results import MethodResult

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Line:
    """How MS or AMS did, on one scale or on many.

    Attributes:
        method: whose segments and metrics.
        scales: one, the same for all channels; or many, all of all channels.
        judged: the matches.
    """

    method: Literal["MS", "AMS"]
    scales: Literal["one", "many"]
    judged: Judged


@dataclass(frozen=True, eq=False)
class CountResult:
    """How combinations of so many channels did, out of all that there are.

    Attributes:
        channels: how many are combined.
        auc: (C,) float64, of each combination that was tried.
        recall: (C,) float64, at 100 % precision.
    """

    channels: int
    auc: Array
    recall: Array


@dataclass(frozen=True)
class Cost:
    """What it costs to match a frame.

    Attributes:
        places: K.
        dimensions: N.
        channels: L.
        longest: the longest scale, frames.
        seconds: to match a frame, measured: all channels, one after the other.
        kept_bytes: of the map's metrics, and of what a stream keeps between two frames, measured.
    """

    places: int
    dimensions: int
    channels: int
    longest: int
    seconds: float
    kept_bytes: int


@dataclass(frozen=True, eq=False)
class FeatureResult:
    """The experiments on one feature.

    Attributes:
        feature: its kind.
        placemap: of AMS.
        fixed: of MS; None where the reference is too short.
        one_scale: the length that stands for all others where there is one scale, frames.
        lines: MS, where it can run, and AMS, on one scale and on many.
        counts: every number of ten channels, ascending; empty where the reference is too short.
        learned: of AMS's first channel; None where there is nothing to show.
        cost: of AMS.
    """

    feature: str
    placemap: Map
    fixed: Map | None
    one_scale: int
    lines: tuple[Line, ...]
    counts: tuple[CountResult, ...]
    learned: Learned | None
    cost: Cost

    def line(self, method: str, scales: str) -> Line | None:
        """Return one of the lines, if it is there."""
        return next((x for x in self.lines if (x.method, x.scales) == (method, scales)), None)


@dataclass(frozen=True, eq=False)
class PaperStudy:
    """The paper's experiments on one drive of a query along a reference.

    Attributes:
        reference: source of the reference's frames, as it was given.
        query: source of the query's frames, likewise.
        protocol: how the query was driven.
        every: n of a protocol that takes every n-th frame; None: it is none.
        seed: of everything random.
        tolerance: places; None where a ground truth was given, or metres.
        features: in the order to show them.
        others: SeqSLAM and FAB-MAP, which use neither.
        ground: by what a match is right.
    """

    reference: str
    query: str
    protocol: Protocol
    every: int | None
    seed: int
    tolerance: int | None
    features: tuple[FeatureResult, ...]
    others: tuple[MethodResult, ...]
    ground: TruthSource
