"""The stage from an explorer's candidate to a match, in place of ``FusionStage``.

An explorer is the only channel, and its candidate is the whole answer.
"""

from collections.abc import Collection, Sequence

from placefield.config import MatchingConfig
from placefield.fusion.match import Match
from placefield.fusion.rules import log_odds
from placefield.fusion.shard_joiner import ShardJoiner
from placefield.matching.candidate import TOO_FAST, UNANSWERED, Candidate
from placefield.matching.explored_candidate import fits, to_answer


class ExplorationStage:
    """Makes a match of what an explorer answered; all streams may share it."""

    def __init__(self, matching: MatchingConfig) -> None:
        """Prepare; of the settings, the precision counts."""
        self._matching = matching

    def warm_up(self) -> None:
        """Do nothing: there is nothing to compile."""

    def fits(self, candidate: Candidate, shards: int = 1) -> bool:
        """Whether a candidate may be of an explorer, which has no shards."""
        return shards == 1 and fits(candidate)

    def new_joiner(self) -> ShardJoiner:
        """Return a joiner of shards, which hands on whole channels."""
        return ShardJoiner(self._matching.rule)

    def fuse(self, candidates: Sequence[Candidate], missing: Collection[int] = ()) -> Match:
        """Make the match of a frame; without a candidate it has no answer."""
        absent = tuple(sorted(missing))
        if not candidates:
            return Match(UNANSWERED, 0.0, absent)
        answer = to_answer(candidates[0], self._matching)
        return Match(
            answer.place,
            log_odds(answer.probability),
            absent,
            answer.probability,
            answer.known,
            answer.too_fast >= TOO_FAST,
            new=answer.new,
        )
