from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield_tools.sources.seconds import nanoseconds


@given(st.integers(0, 2**63 - 1))
def test_seconds_keep_their_nanoseconds(stamp_ns: int) -> None:
    assert nanoseconds(f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09}") == stamp_ns


@given(st.decimals(0, 9_000_000_000, allow_nan=False, allow_infinity=False))
def test_a_fraction_of_a_nanosecond_is_rounded(seconds) -> None:  # type: ignore[no-untyped-def]
    assert abs(nanoseconds(str(seconds)) - Fraction(seconds) * 10**9) <= Fraction(51, 100)


@pytest.mark.timeout(5)  # rounded before it was compared, the first would take a minute
@pytest.mark.parametrize("seconds", ["1e999990", "9223372036.8547758079", "-1", "nan", "inf", ""])
def test_what_no_stamp_can_be_is_refused(seconds: str) -> None:
    with pytest.raises(ValueError, match="must be a number of seconds from 0 up"):
        nanoseconds(seconds)
