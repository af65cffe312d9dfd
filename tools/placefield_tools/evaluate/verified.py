"""The smoothed matches of a query after their verification by geometry."""

from collections.abc import Sequence
from dataclasses import replace

from placefield.fusion.match import SmoothedMatch
from placefield.verification.local_features import LocalFeatures
from placefield.verification.verification_stage import VerificationStage
from placefield_tools.common.parallel import map_in_order


def verified_matches(
    stage: VerificationStage,
    matches: Sequence[SmoothedMatch],
    queries: Sequence[LocalFeatures | None],
) -> list[SmoothedMatch]:
    """Verify the matches of a query of Q frames, in their order.

    A match stays as it is if it cannot be verified, or if its frame cannot be read.

    Args:
        stage: of the map.
        matches: Q smoothed matches.
        queries: local features of the Q frames, None for one that cannot be read.
    """

    def inliers(number: int) -> int | None:
        match, query = matches[number].match, queries[number]
        if query is None or stage.obstacle(match) is not None:
            return None
        return stage.inliers(match, query)

    verified, posterior = [], None
    counts = map_in_order(inliers, range(len(matches)))
    for smoothed, count in zip(matches, counts, strict=True):
        match, _, posterior = stage.verify(smoothed.match, count, posterior)
        verified.append(replace(smoothed, match=match))
    return verified
