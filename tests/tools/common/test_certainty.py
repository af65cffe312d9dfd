import pytest

from placefield.bus.messages import MatchMessage
from placefield.maps.digest import NO_DIGEST
from placefield_tools.common.certainty import certainty_of, percent


def match(probability: float | None, known: bool | None, too_fast: bool = False) -> MatchMessage:
    return MatchMessage(
        map=NO_DIGEST, place=3, score=1.0, probability=probability, known=known, too_fast=too_fast
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (match(0.996, True), "known"),
        (match(0.986, False), "likely"),
        (match(0.5, False), "unknown"),
        (match(0.0, False), "unknown"),
        (match(0.986, False, too_fast=True), "faster than the map resolves"),
        (match(None, None), None),
    ],
)
def test_a_match_that_is_not_known_is_likely_above_even_odds(
    given: MatchMessage, words: str | None
) -> None:
    assert certainty_of(given) == words


@pytest.mark.parametrize(
    ("probability", "text"),
    [
        (0.0, "0.0 %"),
        (0.29, "29.0 %"),
        (0.986, "98.6 %"),
        (0.98999, "98.9 %"),  # not the 99 % that it misses
        (0.99999, "99.9 %"),
        (1.0, "100.0 %"),
    ],
)
def test_a_percentage_is_rounded_down(probability: float, text: str) -> None:
    assert percent(probability) == text
