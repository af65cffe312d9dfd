"""The smoothed matches of a query after their verification by geometry."""

from collections.abc import Sequence
from dataclasses import replace

from placefield.config import Config
from placefield.fusion.match import SmoothedMatch
from placefield.maps.map import Map
from placefield.verification.local_features import LocalFeatures
from placefield.verification.verifying import verify, with_evidence
from placefield_tools.common.parallel import map_in_order


def verified_matches(
    placemap: Map,
    matches: Sequence[SmoothedMatch],
    queries: Sequence[LocalFeatures | None],
    config: Config,
) -> list[SmoothedMatch]:
    """Verify the matches of a query of Q frames.

    A match stays as it is if its probability is too low, or if the frame cannot be read.

    Args:
        placemap: the map; without local features no match changes.
        matches: Q smoothed matches, with probabilities.
        queries: local features of the Q frames, None for one that cannot be read.
        config: its verification and the precision asked for.
    """
    places, least = placemap.local_features, config.verification.least_probability

    def verified(number: int) -> SmoothedMatch:
        smoothed, query = matches[number], queries[number]
        match = smoothed.match
        if places is None or query is None or match.place < 0 or (match.probability or 0) < least:
            return smoothed
        found = verify(places, match.place, match.probability or 0, query, placemap.seed)
        return replace(smoothed, match=with_evidence(match, found, config.matching.precision))

    return list(map_in_order(verified, range(len(matches))))
