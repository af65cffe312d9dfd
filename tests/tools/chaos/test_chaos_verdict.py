"""Answers held against those of an undisturbed run."""

import json

from placefield.fusion.match import Match
from placefield_tools.chaos.schedule import Fault
from placefield_tools.chaos.verdict import Answered, Happened, judge

UNDISTURBED = [Match(frame, 1.0) for frame in range(10)]
KILLED = Fault("kill channel", at=4, end=4, draw=0)
WHOLE = {frame: Answered(match, float(frame)) for frame, match in enumerate(UNDISTURBED)}


def flagged(frame: int, at: float) -> Answered:
    return Answered(Match(frame, 0.5, missing=(1,)), at)


def test_a_run_like_the_undisturbed_one_holds() -> None:
    verdict = judge(UNDISTURBED, WHOLE, [], 10)
    assert verdict.holds
    assert verdict.as_json() == {
        "sent": 10,
        "answered": 10,
        "partial": 0,
        "wrong": 0,
        "recover_s": 0.0,
        "faults": [],
    }


def test_a_flagged_answer_may_differ_and_no_other() -> None:
    assert judge(UNDISTURBED, WHOLE | {5: flagged(5, 5.0)}, [], 10).holds
    wrong = judge(UNDISTURBED, WHOLE | {5: Answered(Match(5, 0.5), 5.0)}, [], 10)
    assert (wrong.wrong, wrong.holds) == (1, False)


def test_an_answer_that_is_missing_is_reported() -> None:
    lost = {frame: answered for frame, answered in WHOLE.items() if frame != 7}
    verdict = judge(UNDISTURBED, lost, [], 10)
    assert (verdict.answered, verdict.wrong, verdict.holds) == (9, 0, False)


def test_a_system_is_well_again_when_it_answers_what_was_sent_after_the_fault() -> None:
    late = {4: flagged(4, 6.5), 5: flagged(5, 7.0)} | {6: Answered(UNDISTURBED[6], 7.25)}
    under_way = {3: Answered(UNDISTURBED[3], 4.75)}
    verdict = judge(UNDISTURBED, WHOLE | under_way | late, [Happened(KILLED, 4, 4.5)], 10)
    # Frames 7 to 9 would have been answered at 7, 8 and 9 s: out of turn, but that is not judged.
    assert verdict.recover_s == 2.5
    assert verdict.holds


def test_a_system_that_is_never_well_again_does_not_hold() -> None:
    answers = WHOLE | {frame: flagged(frame, float(frame)) for frame in range(4, 10)}
    verdict = judge(UNDISTURBED, answers, [Happened(KILLED, 4, 4.0)], 10)
    assert (verdict.recover_s, verdict.partial, verdict.holds) == (None, 6, False)
    (fault,) = json.loads(json.dumps(verdict.as_json()))["faults"]
    assert fault == {"kind": "kill channel", "at": 4, "end": 4, "draw": 0, "is_last": False} | {
        "recover_s": None
    }


def test_a_system_whose_memory_was_lost_is_well_again_though_all_its_answers_say_so() -> None:
    forgotten = {
        frame: Answered(Match(frame, 0.5, forgotten=True), float(frame)) for frame in range(5, 10)
    }
    verdict = judge(UNDISTURBED, WHOLE | forgotten, [Happened(KILLED, 4, 4.5)], 10)
    assert (verdict.partial, verdict.wrong, verdict.holds) == (5, 0, True)
