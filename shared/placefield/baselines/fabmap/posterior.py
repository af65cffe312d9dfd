"""The place of a query frame, by Bayes' rule over the map's places and a new place."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from placefield.baselines.fabmap.chow_liu import ChowLiuTree
from placefield.baselines.fabmap.likelihood import log_likelihoods
from placefield.fusion.match import Match
from placefield.matching.candidate import UNANSWERED


@dataclass(frozen=True)
class FabMap:
    """FAB-MAP's assumptions; the probabilities are openFABMAP's, all above 0 but the second.

    Attributes:
        detection: p(z = 1 | e = 1), that the detector reports a word that is there.
        false_detection: p(z = 1 | e = 0), that it reports a word that is not there; less than
            `detection`.
        new_place: prior probability that a frame is of none of the map's places.
        samples: number of observations sampled for the likelihood of a new place.
    """

    detection: float = 0.39
    false_detection: float = 0.0
    new_place: float = 0.9
    samples: int = 3000


OPEN_FABMAP = FabMap()


def fabmap(
    reference: NDArray[np.bool_],
    query: NDArray[np.bool_],
    tree: ChowLiuTree,
    settings: FabMap = OPEN_FABMAP,
    seed: int = 0,
) -> list[Match]:
    """Match each query frame to the map's most probable place.

    Every frame is answered by itself: there is no motion model, as by default in openFABMAP. The
    match is the best place of the map even if a new place is more probable, so that precision and
    recall can be swept over the score; at a negative score a new place is more probable. A frame
    without words is unanswered.

    Args:
        reference: (K, W) bool, which words each place has; K at least 1.
        query: (Q, W) bool, which words each query frame has.
        tree: learned on the reference.
        settings: the assumptions.
        seed: of the sampled observations.

    Returns:
        Q matches; the score is the log-odds of the place's posterior probability.
    """
    posterior = log_posterior(reference, query, tree, settings, seed)
    places = posterior[:, :-1].argmax(axis=1)
    frames = np.arange(len(query))
    chosen = posterior[frames, places]
    # Summed, not 1 - p: probabilities that round to 1 must not tie.
    posterior[frames, places] = -np.inf
    scores = chosen - logsumexp(posterior, axis=1)
    places[~query.any(axis=1)] = UNANSWERED
    return [Match(int(place), float(score)) for place, score in zip(places, scores, strict=True)]


def log_posterior(
    reference: NDArray[np.bool_],
    query: NDArray[np.bool_],
    tree: ChowLiuTree,
    settings: FabMap,
    seed: int,
) -> NDArray[np.float64]:
    """Compute log p(L | Z) of every place and, last, of a new place; arguments as `fabmap`'s.

    A new place's likelihood is the mean over observations sampled from the tree. FAB-MAP can also
    sample the training frames. Those are the map itself here, and a new place would keep its prior
    probability for every frame. A frame without words does not change the prior.

    Returns:
        (Q, K + 1) float64, each row's probabilities summing to 1.
    """
    detector = (settings.false_detection, settings.detection)
    known = log_likelihoods(query, reference, tree, detector)
    drawn = log_likelihoods(query, tree.sample(settings.samples, seed), tree, detector)
    new = logsumexp(drawn, axis=1) - np.log(settings.samples)

    likelihood = np.column_stack([known, new])
    likelihood[~query.any(axis=1)] = 0
    prior = np.full(len(reference) + 1, (1 - settings.new_place) / len(reference))
    prior[-1] = settings.new_place
    joint = likelihood + np.log(prior)
    return np.asarray(joint - logsumexp(joint, axis=1, keepdims=True), np.float64)
