"""The candidates of a channel's shards to that of the channel."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from placefield.config import Rule
from placefield.matching.candidate import NO_CANDIDATE, UNANSWERED, Candidate
from placefield.matching.trace import NEGLIGIBLE


class ShardJoiner:
    """Joins the candidates of a stream's frames, shard by shard as they come."""

    def __init__(self, rule: Rule) -> None:
        """Take the rule by which they are made."""
        self._rule: Rule = rule
        self._shards: dict[tuple[int, int, int], dict[int, Candidate]] = {}

    def add(
        self, sequence: int, channel: int, shard: int, shards: int, candidate: Candidate
    ) -> Candidate | None:
        """Take what a shard answers for a frame; return what its channel does, once all have."""
        if shards == 1:
            return candidate
        there = self._shards.setdefault((sequence, channel, shards), {})
        there.setdefault(shard, candidate)
        if len(there) < shards:
            return None
        del self._shards[sequence, channel, shards]
        return join_shards([there[number] for number in sorted(there)], self._rule)

    def forget_before(self, sequence: int) -> None:
        """Drop what is of frames before this one."""
        for key in [key for key in self._shards if key[0] < sequence]:
            del self._shards[key]


def join_shards(candidates: Sequence[Candidate], rule: Rule) -> Candidate:
    """Return what a matcher of the whole map would have answered.

    How likely the vehicle is too fast, every shard knows of the whole map.

    Args:
        candidates: of all shards of a channel for one frame, in the order of their places.
        rule: by which they were made.
    """
    if any(candidate.place == UNANSWERED for candidate in candidates):
        return NO_CANDIDATE  # what keeps one shard from an answer keeps all
    sign = 1 if rule == "filter" else -1
    best = max(candidates, key=lambda candidate: sign * candidate.score)
    places = np.concatenate([candidate.places for candidate in candidates])
    evidence = np.concatenate([candidate.evidence for candidate in candidates])
    if rule == "filter":  # each shard tells its own best place, even if that is next to nothing
        told = (evidence >= np.float32(NEGLIGIBLE)) | (places == best.place)
        places, evidence = places[told], evidence[told]
    return replace(best, places=places, evidence=evidence)
