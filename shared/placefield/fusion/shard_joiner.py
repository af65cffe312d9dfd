"""Joins the candidates of a channel's shards into the candidate of the channel."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from placefield.config import Rule
from placefield.matching.candidate import NO_CANDIDATE, UNANSWERED, Candidate
from placefield.matching.trace import NEGLIGIBLE


class ShardJoiner:
    """Joins the candidates of a stream's frames, shard by shard as they arrive."""

    def __init__(self, rule: Rule) -> None:
        """Prepare for candidates of this rule."""
        self._rule: Rule = rule
        self._shards: dict[tuple[int, int, int], dict[int, Candidate]] = {}

    def add(
        self, sequence: int, channel: int, shard: int, shards: int, candidate: Candidate
    ) -> Candidate | None:
        """Add a shard's candidate for a frame; return the channel's once it is complete."""
        if shards == 1:
            return candidate
        there = self._shards.setdefault((sequence, channel, shards), {})
        there.setdefault(shard, candidate)
        if len(there) < shards:
            return None
        del self._shards[sequence, channel, shards]
        return join_shards([there[number] for number in sorted(there)], self._rule)

    def forget_before(self, sequence: int) -> None:
        """Drop the candidates of frames before this one."""
        for key in [key for key in self._shards if key[0] < sequence]:
            del self._shards[key]


def join_shards(candidates: Sequence[Candidate], rule: Rule) -> Candidate:
    """Return the candidate that a matcher of the whole map would have returned.

    ``too_fast`` is the same in every shard, because it is of the whole map.

    Args:
        candidates: of all shards of a channel for one frame, in the order of their places.
        rule: by which they were made.
    """
    if any(candidate.place == UNANSWERED for candidate in candidates):
        return NO_CANDIDATE  # if one shard has no candidate, none has
    sign = 1 if rule == "filter" else -1
    best = max(candidates, key=lambda candidate: sign * candidate.score)
    places = np.concatenate([candidate.places for candidate in candidates])
    evidence = np.concatenate([candidate.evidence for candidate in candidates])
    if rule == "filter":  # each shard has its own best place, even if its belief is negligible
        kept = (evidence >= np.float32(NEGLIGIBLE)) | (places == best.place)
        places, evidence = places[kept], evidence[kept]
    return replace(best, places=places, evidence=evidence)
