import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from placefield.evaluation.claims import Claims, claims

frames = st.lists(
    st.sampled_from([(True, True, True), (True, False, True), (True, False, False)])
    | st.sampled_from([(False, True, True), (False, False, True), (False, False, False)]),
    max_size=30,
)


@given(frames)
def test_claims_are_those_of_counting_by_hand(rows: list[tuple[bool, bool, bool]]) -> None:
    known, correct, on_route = np.array(rows, np.bool_).reshape(-1, 3).T
    claimed = [row for row in rows if row[0]]
    right = sum(1 for row in claimed if row[1])
    on = sum(1 for row in rows if row[2])
    expected = Claims(
        len(claimed), right / len(claimed) if claimed else 1.0, right / on if on else 0.0
    )
    assert claims(known, correct, on_route) == expected
