"""How a source verifies the answers to its frames."""

import pytest

from placefield.bus.proof import Proof


def sent(frames: int, *, again: int = 0) -> Proof:
    """Return the proof of some sent frames and the end; the first frames were sent again."""
    proof = Proof()
    for sequence in (*range(frames + 1), *range(again)):
        proof.send(sequence)
    return proof


def test_an_answer_stands_for_all_frames_before_it_whose_matches_have_come() -> None:
    proof = sent(5)
    assert [proof.match(sequence, 5) for sequence in range(3)] == [None] * 3
    assert proof.claim(2, 5) == 2
    assert [proof.match(sequence, 5) for sequence in (3, 4)] == [None] * 2
    assert proof.claim(5, 5) == 5  # the end
    assert (proof.matched, proof.forged) == (5, 0)


@pytest.mark.parametrize("claimed", [1, 3, 5])
def test_an_answer_before_a_match_that_it_stands_for_is_counted_and_waits_for_it(
    claimed: int,
) -> None:
    proof = sent(5)
    proof.match(0, 5)
    assert proof.claim(claimed, 5) is None
    assert proof.forged == 1
    answered = [proof.match(sequence, 5) for sequence in range(1, 5)]
    assert [sequence for sequence in answered if sequence is not None] == [claimed]
    assert proof.claim(min(claimed, 4), 5) == min(claimed, 4)  # the fuser's own
    assert proof.forged == 1


def test_matches_may_come_in_any_order() -> None:
    proof = sent(3)
    assert [proof.match(sequence, 3) for sequence in (2, 0)] == [None, None]
    assert proof.matched == 1
    proof.match(1, 3)
    assert proof.matched == 3


def test_an_answer_or_match_too_many_is_counted() -> None:
    proof = sent(3)
    for sequence in (0, 1, 1, 2):
        proof.match(sequence, 3)
    for sequence in (2, 2, 0):
        proof.claim(sequence, 3)
    assert proof.forged == 2


def test_a_frame_that_was_sent_again_may_be_answered_again() -> None:
    proof = sent(3, again=2)
    for sequence in (0, 1, 2, 0, 1):
        proof.match(sequence, 3)
        proof.claim(sequence, 3)
    assert proof.forged == 0


def test_the_state_of_a_long_stream_stays_small() -> None:
    proof = Proof()
    for sequence in range(10_000):
        proof.send(sequence)
        proof.match(sequence, sequence + 1)
        assert proof.claim(sequence, sequence + 1) == sequence
    held = sum(len(each) for each in vars(proof).values() if hasattr(each, "__len__"))
    assert held < 6000
    assert proof.forged == 0
