"""The stage from candidates to a match: it joins shards, checks candidates, and fuses them.

It has no bus and no clock: the library and a fuser both use it. The ``Joiner`` decides which
candidates to wait for.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from placefield.config import MatchingConfig, Rule
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.fusion.shard_joiner import ShardJoiner
from placefield.maps.topology import Topology
from placefield.matching.best_window import vicinity_of
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield.pose import Pose


def _unposed(place: int) -> None:
    """Return None: no place has a known pose."""


class AnyFusionStage(Protocol):
    """What a fuser makes matches with; all streams share it. See ``FusionStage``."""

    def warm_up(self) -> None:
        """Compile all that fusion uses."""

    def fits(self, candidate: Candidate, shards: int = 1) -> bool:
        """Whether a candidate of another process may be of the map and the rule."""

    def new_joiner(self) -> ShardJoiner:
        """Return a joiner of the shards' candidates, for a new stream."""

    def fuse(self, candidates: Sequence[Candidate], missing: Collection[int] = ()) -> Match:
        """Make one match of the candidates of a frame."""


class FusionStage:
    """Fuses the candidates of channels of a map; all streams may share it."""

    def __init__(
        self,
        topology: Topology,
        matching: MatchingConfig,
        pose_of: Callable[[int], Pose | None] = _unposed,
    ) -> None:
        """Prepare for a map.

        Args:
            topology: of the map.
            matching: how candidates are made and fused.
            pose_of: returns the pose of a place, see ``Places.pose``, or None if it is unknown.
        """
        self._places = topology.count
        self._vicinity = vicinity_of(topology, matching.tolerance)
        self._matching = matching
        self._pose_of = pose_of

    def warm_up(self) -> None:
        """Fuse a candidate of no frame, to compile all that fusion uses."""
        places = np.arange(self._places, dtype=np.int32)
        belief = np.full(self._places, 1 / self._places, np.float32)
        self.fuse([Candidate(0, float(belief[0]), places, belief)])

    def fits(self, candidate: Candidate, shards: int = 1) -> bool:
        """Whether a candidate may be of the map and the rule.

        Args:
            candidate: from another process.
            shards: how many shards the channel has. For one of several, only the size is checked:
                the joined candidate of the channel must be checked again.
        """
        if shards > 1:
            return len(candidate.evidence) <= self._places
        return _fits(candidate, self._matching.rule, self._places)

    def new_joiner(self) -> ShardJoiner:
        """Return a joiner of the shards' candidates, for a new stream."""
        return ShardJoiner(self._matching.rule)

    def fuse(self, candidates: Sequence[Candidate], missing: Collection[int] = ()) -> Match:
        """Make one match of the candidates, in the order of their channels.

        Args:
            candidates: of whole channels for one frame, that fit the map.
            missing: the channels that have no candidate.
        """
        match = fuse(candidates, self._matching, self._vicinity, missing)
        pose = None if match.place == UNANSWERED else self._pose_of(match.place)
        return match if pose is None else replace(match, pose=pose)


def _fits(candidate: Candidate, rule: Rule, count: int) -> bool:
    """Whether place and evidence have the form of the rule, in a map of so many places."""
    places, evidence = candidate.places, candidate.evidence
    if candidate.place >= count:
        return False
    if rule == "ams" or candidate.place == UNANSWERED:
        return len(places) == len(evidence) == 0
    if rule == "evidence":
        return len(places) == 0 and len(evidence) == count
    if not len(places) == len(evidence) > 0:
        return False
    return bool(places[0] >= 0 and places[-1] < count and (places[:-1] < places[1:]).all())
