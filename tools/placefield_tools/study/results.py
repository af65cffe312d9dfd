"""What a study finds."""

from dataclasses import dataclass
from typing import Literal

from placefield.config import Rule
from placefield.evaluation.protocols import Protocol
from placefield.maps.map import Map
from placefield_tools.evaluate.judging import Judged
from placefield_tools.evaluate.truth_source import TruthSource
from placefield_tools.study.neighbours import Learned

LeftOut = Literal["nothing", "several scales", "adaptive scales", "metric", "channels"]
"""A part of the method: several scales per channel, adaptive ones, a learned metric, channels."""


@dataclass(frozen=True, eq=False)
class MethodResult:
    """How one method did on the query.

    Attributes:
        name: of the method.
        ours: whether it is Placefield's own.
        oracle: whether it is the best of the fixed windows of its lag, which needs the ground truth
            to choose.
        judged: its matches; None where it failed.
        failure: one line that says why it failed; None where it did not.
        frames_to_recover: median over the drive's jumps; None where there are none, or it failed.
        lag: maximum number of later frames that a match uses; ``judged`` has the mean number.
    """

    name: str
    ours: bool
    oracle: bool
    judged: Judged | None
    failure: str | None
    frames_to_recover: float | None
    lag: int = 0


@dataclass(frozen=True, eq=False)
class AblationResult:
    """How the method did without one of its parts.

    Attributes:
        rule: that matched.
        left_out: the part.
        lag: how many frames after the matched one it may look at, at most.
        judged: its matches.
    """

    rule: Rule
    left_out: LeftOut
    lag: int
    judged: Judged


@dataclass(frozen=True, eq=False)
class Study:
    """Every method's results on one drive of a query along a reference.

    Attributes:
        reference: source of the reference's frames, as it was given.
        query: source of the query's frames, likewise.
        protocol: how the query was driven.
        every: n of a protocol that takes every n-th frame; None: it is none.
        lowered_min_scale: shortest segment of our maps, places, where the thinned reference was too
            short for the one asked for.
        seed: of everything random.
        tolerance: places; None where a ground truth was given, or metres.
        placemap: our map of the reference.
        fixed: the map of MS, whose segments are of fixed lengths; None where the reference is too
            short.
        learned: what the metric of our map's first channel does; None where there is nothing to
            show.
        methods: in the order to show them.
        ablation: by two rules, each with every part left out, at every lag.
        ground: by what a match is right.
    """

    reference: str
    query: str
    protocol: Protocol
    every: int | None
    lowered_min_scale: int | None
    seed: int
    tolerance: int | None
    placemap: Map
    fixed: Map | None
    learned: Learned | None
    methods: tuple[MethodResult, ...]
    ablation: tuple[AblationResult, ...]
    ground: TruthSource
