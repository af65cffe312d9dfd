"""The posterior of a verified match is checked before a verifier continues from it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.bus.verified_messages import VerifiedMessage
from placefield.errors import MessageError
from placefield.maps.digest import NO_DIGEST
from placefield.verification.inlier_model import STATES

EVEN = np.full(STATES, 1 / STATES)


def verified(posterior: NDArray[np.floating] | None) -> VerifiedMessage:
    """A message whose posterior has not been checked yet."""
    checked = VerifiedMessage(map=NO_DIGEST, place=7, score=0.9, lag=3, reason="no_frame")
    return checked.model_copy(update={"posterior": posterior})


def changed(first: float, second: float = 1 / STATES) -> NDArray[np.float64]:
    return np.concatenate([[first, second], EVEN[2:]])


@pytest.mark.parametrize("posterior", [None, EVEN, np.eye(STATES)[5]])
def test_a_posterior_comes_back_to_the_bit(posterior: NDArray[np.float64] | None) -> None:
    again = VerifiedMessage.decode(verified(posterior).encode()).posterior
    assert (again is None) == (posterior is None)
    assert posterior is None or again is None or again.tobytes() == posterior.tobytes()


@pytest.mark.parametrize(
    "posterior",
    [
        EVEN[:-1],
        np.append(EVEN, 0),
        EVEN.reshape(-1, 3),
        EVEN.astype(np.float32),
        np.zeros(0),
        np.zeros(STATES),
        EVEN * 1.001,
        changed(-1 / STATES, 3 / STATES),
        changed(np.nan),
        changed(np.inf),
        changed(np.inf, -np.inf),
    ],
)
def test_other_posteriors_are_refused(posterior: NDArray[np.floating]) -> None:
    with pytest.raises(MessageError, match="posterior"):
        VerifiedMessage.decode(verified(posterior).encode())
