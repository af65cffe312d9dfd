"""Matches that were never made, of every kind there is."""

from collections.abc import Sequence

from hypothesis import strategies as st

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.verified_messages import VerifiedMessage
from placefield.maps.digest import NO_DIGEST

Written = tuple[Header, MatchMessage | None]

STAMPS_NS = (1_700_000_000_123_456_789, 1_700_000_000_223_456_789, 1_700_000_000_323_456_789)


def stream_of(matches: Sequence[MatchMessage], name: str = "drive") -> list[Written]:
    """Return the matches with their headers, 0.1 s apart, and the end of the stream."""
    stamps = [STAMPS_NS[0] + 100_000_000 * number for number in range(len(matches) + 1)]
    written: list[Written] = [
        (Header(stream=name, sequence=number, stamp_ns=stamps[number]), match)
        for number, match in enumerate(matches)
    ]
    end = Header(stream=name, sequence=len(matches), stamp_ns=stamps[-1], end=True)
    return [*written, (end, None)]


KNOWN = MatchMessage(
    map=NO_DIGEST, place=7, score=1 / 3, probability=0.999, known=True, pose=(1.5, -2.25, 0.5)
)
UNKNOWN = MatchMessage(
    map=NO_DIGEST, place=9, score=-2.0, probability=0.25, known=False, pose=(8.0, 9.0, 0.0)
)
UNTOLD = MatchMessage(map=NO_DIGEST, place=3, score=4.0, missing=(0, 12), pose=(3.0, 4.0, -3.0))
UNANSWERED = MatchMessage(map=NO_DIGEST, place=-1, score=0.0, missing=(1,))
ALL_KINDS = (KNOWN, UNKNOWN, UNTOLD, UNANSWERED)

SMOOTHED = SmoothedMessage(**KNOWN.model_dump() | {"place": 8}, lag=3)

VERIFIED = VerifiedMessage(**SMOOTHED.model_dump() | {"score": 2.5}, inliers=31, ratio=0.5)
UNVERIFIED = VerifiedMessage(**SMOOTHED.model_dump(), reason="no_frame")

OF_HEADER = {"stream", "sequence", "stamp_ns", "end", "smoothed", "verified"}
"""What a written match has besides its message."""

finite = st.floats(allow_nan=False, allow_infinity=False)
headers = st.builds(
    Header,
    stream=st.text(st.characters(codec="utf-8"), min_size=1, max_size=64),
    sequence=st.integers(0, 2**48 - 1),
    stamp_ns=st.integers(-(2**63), 2**63 - 1),
)
matches = st.builds(
    MatchMessage,
    map=st.just(NO_DIGEST),
    place=st.integers(-1, 2**31 - 1),
    score=finite,
    missing=st.lists(st.integers(0, 2**16 - 1), max_size=4).map(tuple),
    probability=st.none() | st.floats(0, 1),
    known=st.none() | st.booleans(),
    too_fast=st.booleans(),
    pose=st.none() | st.tuples(finite, finite, finite),
)
