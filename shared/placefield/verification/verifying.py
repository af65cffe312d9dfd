"""Verifies a match by geometry: inliers, likelihood ratio, the probability after it."""

import math
from dataclasses import replace
from typing import NamedTuple

from placefield.fusion.match import Match
from placefield.verification.likelihood import ratio_of, updated
from placefield.verification.local_features import LocalFeatures
from placefield.verification.place_features import PlaceFeatures
from placefield.verification.two_views import LEAST, correspondences, epipolar_inliers


class Verification(NamedTuple):
    """What geometry says about a match.

    Attributes:
        inliers: the number of correspondences that fit one epipolar geometry.
        ratio: how much likelier that number is at the matched place than elsewhere.
        probability: of the match after this evidence.
    """

    inliers: int
    ratio: float
    probability: float


def verify(
    places: PlaceFeatures, place: int, probability: float, query: LocalFeatures, seed: int
) -> Verification:
    """Compare a frame with its matched place; a place of few local features says nothing.

    Args:
        places: of the map.
        place: the matched place.
        probability: of the match.
        query: local features of the frame.
        seed: of RANSAC: the same input gives the same result.
    """
    own = places.of(place)
    inliers = int(epipolar_inliers(correspondences(own, query), seed).sum())
    ratio = ratio_of(places.ratios, inliers) if len(own.points) >= LEAST else 1.0
    return Verification(inliers, ratio, updated(probability, ratio))


def with_evidence(match: Match, verification: Verification, precision: float) -> Match:
    """Return a match with the probability after its verification.

    Args:
        match: with a probability.
        verification: of this match.
        precision: probability from which a match is known.
    """
    probability = verification.probability
    score = match.score + math.log(verification.ratio)  # log odds, before and after
    known = probability >= precision and not match.too_fast
    return replace(match, probability=probability, known=known, score=score)
