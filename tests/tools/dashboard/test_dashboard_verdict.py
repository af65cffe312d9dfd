import numpy as np
import pytest

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.config import Rule
from placefield.maps.digest import NO_DIGEST
from placefield.matching.candidate import Candidate
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.verdict import belief_of, verdict_of


def candidate(*beliefs: tuple[int, float]) -> Candidate:
    places = np.array([place for place, _ in beliefs], np.int32)
    evidence = np.array([belief for _, belief in beliefs], np.float32)
    return Candidate(int(places[0]), float(evidence[0]), places, evidence)


def answer(
    match: MatchMessage,
    *candidates: Candidate,
    sequence: int = 100,
    rule: Rule = "filter",
) -> Answer:
    header = Header(stream="s", sequence=sequence, stamp_ns=0)
    return Answer(0, header, match, rule, dict(enumerate(candidates)), None)


def match(probability: float | None, *, known: bool | None = False, **more: object) -> MatchMessage:
    fields = {"place": 3, "score": 1.0, "probability": probability, "known": known} | more
    return MatchMessage.model_validate({"map": NO_DIGEST, **fields})


HERE, AWAY = candidate((3, 0.9), (4, 0.05)), candidate((3, 0.1), (4, 0.05))


@pytest.mark.parametrize(
    ("given", "words", "kind"),
    [
        (answer(match(None, known=None, place=-1)), "no place", "plain"),
        (answer(match(None, known=None), rule="ams"), "matched", "plain"),
        (answer(match(0.996, known=True), HERE), "known, 99.6 %", "known"),
        (answer(match(0.985), HERE), "likely, 98.5 % (99 % asked)", "likely"),
        (answer(match(0.4), HERE), "unknown, 40.0 % (99 % asked)", "unknown"),
        (answer(match(0.1), AWAY), "not on this route", "unknown"),
        (answer(match(0.1), AWAY, sequence=5), "looking for the place", "unknown"),
        (answer(match(0.1)), "unknown, 10.0 % (99 % asked)", "unknown"),
        (answer(match(0.1, too_fast=True), AWAY), "faster than the map resolves", "unknown"),
    ],
)
def test_the_verdict_says_what_the_answer_comes_to(given: Answer, words: str, kind: str) -> None:
    verdict = verdict_of(given, 0.99)
    assert (verdict.words, verdict.kind) == (words, kind)


def test_the_belief_is_the_mean_of_the_channels() -> None:
    found = belief_of(answer(match(0.5), candidate((3, 0.5), (7, 0.25)), candidate((3, 1.0))))
    assert found[0].tolist() == [3, 7]
    np.testing.assert_allclose(found[1], [0.75, 0.125])
    places, _ = belief_of(answer(match(0.5), HERE, rule="evidence"))
    assert not len(places)
