"""Any bytes are a message within its documented limits, or are refused with one short line."""

import struct
import tracemalloc
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placefield.bus.candidate_messages import (
    CandidatesMessage,
    ChannelCandidate,
    ChannelPartial,
    FinishedMessage,
    HaloMessage,
    SmoothedFrame,
    SmoothedFrames,
)
from placefield.bus.message import Header, Message
from placefield.bus.messages import (
    CacheQuery,
    FeatureMessage,
    FrameMessage,
    MatchMessage,
    MissingObservationMessage,
    MomentsMessage,
    OdometryMessage,
    RawFeatureMessage,
    SmoothedMessage,
    StatsMessage,
)
from placefield.bus.verified_messages import RelativePoseMessage, VerifiedMessage
from placefield.errors import MessageError
from placefield.features.calibration import Calibration
from placefield.maps.digest import NO_DIGEST
from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.verification.inlier_model import STATES

pytestmark = pytest.mark.slow

VECTOR = np.linspace(-1, 1, 5, dtype=np.float32)
PLACES = np.arange(5, dtype=np.int32)
SETTLED = SmoothedFrames.of(
    9,
    [
        SmoothedFrame(3, 4, 5, Candidate(2, 0.5, PLACES, VECTOR, 0.75)),
        SmoothedFrame(3, 5, 4, NO_CANDIDATE),
        SmoothedFrame(4, 8, 1, Candidate(0, 0.25, PLACES[:2], VECTOR[:2])),
    ],
)
EXAMPLES: list[Message] = [
    Header(stream="s" * 32, sequence=2**40, stamp_ns=-5, live=True),
    FrameMessage(image=bytes(range(90)), odometry_m=12.5),
    FrameMessage(image=np.zeros((3, 4, 3), np.uint8)),
    FrameMessage(
        image=bytes(90),
        calibration=Calibration(
            model="fisheye",
            width=640,
            height=480,
            focal=(300.0, 310.5),
            centre=(320.0, 240.0),
            distortion=(0.1, 0.0, -0.1, 0.0),
        ),
    ),
    FrameMessage(descriptor=VECTOR.astype(np.float16), odometry_m=2.0),
    RawFeatureMessage(model="0123456789abcdef", raw=VECTOR),
    FeatureMessage(model="0123456789abcdef", descriptor=VECTOR, odometry_m=0.0),
    CandidatesMessage(
        map=NO_DIGEST,
        rule="filter",
        candidates=(
            ChannelCandidate(
                channel=3, place=4, score=0.5, places=PLACES, evidence=VECTOR + 1, too_fast=0.25
            ),
        ),
        smoothed=SETTLED,
    ),
    HaloMessage(
        map=NO_DIGEST,
        shard=1,
        shards=2,
        partials=(ChannelPartial(channel=3, partial=VECTOR.astype(np.float64)),),
    ),
    MissingObservationMessage(reason="blank"),
    MomentsMessage(frames=21.0, sums=np.ones((2, 5))),
    CacheQuery(stream="s", first=0, end=2**48),
    MatchMessage(
        map=NO_DIGEST,
        place=7,
        score=0.9,
        missing=(1, 2),
        probability=0.4,
        known=False,
        pose=(1.0, 2.0, 3.0),
    ),
    FinishedMessage(map=NO_DIGEST, rule="filter", channels=(3, 4), smoothed=SETTLED),
    SmoothedMessage(
        map=NO_DIGEST, place=7, score=0.9, missing=(1,), probability=0.4, known=False, lag=3
    ),
    VerifiedMessage(
        map=NO_DIGEST,
        place=7,
        score=0.9,
        probability=0.4,
        known=False,
        lag=3,
        inliers=31,
        ratio=12.5,
        posterior=np.full(STATES, 1 / STATES),
        relative=RelativePoseMessage(
            rotation=((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
            direction=(0.0, 0.6, 0.8),
            covariance=((1.0, 2.0, 3.0, 4.0, 5.0),) * 5,
            distance_m=2.0,
            deviation_m=0.25,
        ),
    ),
    VerifiedMessage(map=NO_DIGEST, place=-1, score=0.9, lag=3, reason="unlikely"),
    OdometryMessage(metres=12.5),
    StatsMessage(service="fuser", counts={"matches": 9, "stale": 0}),
]
HOMES = {
    f"placefield.bus.{name}"
    for name in ("message", "messages", "candidate_messages", "verified_messages")
}
KINDS = sorted({type(example) for example in EXAMPLES}, key=lambda kind: kind.__name__)
PARTS = {
    *ChannelCandidate.model_fields,
    *SmoothedFrames.model_fields,
    *RelativePoseMessage.model_fields,
    *Calibration.model_fields,
    "partial",
    "dtype",
    "shape",
    "data",
}
FIELDS = sorted({name for kind in KINDS for name in kind.model_fields} | PARTS)

kinds = st.sampled_from(KINDS)
encoded_examples = st.sampled_from([example.encode() for example in EXAMPLES])
leaves = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.sampled_from([-1, 0, 1, 2**31, 2**48, 2**63, -(2**63), 2**64 - 1])
    | st.floats()
    | st.text(max_size=70)
    | st.sampled_from(["uint8", "float32", "int32", "object", "filter", "evidence"])
    | st.binary(max_size=40)
    | st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=20))
)
arrays = st.fixed_dictionaries(
    {
        "dtype": st.sampled_from(["uint8", "float32", "float64", "int32", "int64"]) | leaves,
        "shape": st.lists(st.integers(-1, 12) | leaves, max_size=4) | leaves,
        "data": st.binary(max_size=60) | leaves,
    }
)
candidates = st.fixed_dictionaries(
    {
        "channel": st.integers(0, 9) | leaves,
        "place": st.integers(-1, 9) | leaves,
        "score": st.floats(0, 1) | leaves,
        "places": arrays,
        "evidence": arrays,
        "too_fast": st.floats(0, 1) | leaves,
    }
)
smoothed = st.fixed_dictionaries(dict.fromkeys(SmoothedFrames.model_fields, arrays))
partials = st.fixed_dictionaries({"channel": st.integers(0, 9) | leaves, "partial": arrays})
values = st.recursive(
    leaves | arrays | candidates | smoothed | st.lists(candidates | partials, max_size=3),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(FIELDS) | st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=15,
)
# Pieces of msgpack: what begins a list, a mapping, text, bytes or an extension, with any length.
pieces = st.one_of(
    st.integers(0, 255).map(lambda byte: bytes([byte])),
    st.builds(
        lambda kind, length: bytes([kind]) + struct.pack(">I", length),
        st.sampled_from([0xC6, 0xC9, 0xDB, 0xDD, 0xDF]),
        st.integers(0, 40) | st.integers(0, 2**32 - 1),
    ),
    st.sampled_from(FIELDS).map(msgpack.packb),
    leaves.map(msgpack.packb),
    st.sampled_from([b"\xa3\xed\xa0\x80", b"\xa2\xff\xfe", b"\xd6\xff\0\0\0\1", b"\xc1"]),
)


def decode_or_refuse(kind: type[Message], data: bytes) -> Message | None:
    try:
        message = kind.decode(data)
    except MessageError as error:
        line = str(error)
        assert len(line.splitlines()) == 1
        assert len(line) < 500
        return None
    check_bounds(message)
    assert kind.decode(message.encode()).encode() == message.encode()
    return message


def check_bounds(message: Message) -> None:
    """Check the limits in the docstrings of the messages, with independent code."""
    assert message.version == 3
    match message:
        case Header():
            assert 1 <= len(message.stream) <= 64
            assert 0 <= message.sequence < 2**48
            assert -(2**63) <= message.stamp_ns < 2**63
            assert isinstance(message.live, bool)
            assert isinstance(message.end, bool)
        case FrameMessage():
            assert message.odometry_m is None or 0 <= message.odometry_m < np.inf
            assert (message.image is None) != (message.descriptor is None)
            if message.descriptor is not None:
                assert message.descriptor.dtype in (np.float16, np.float32)
                assert message.descriptor.ndim == 1
                assert message.descriptor.size
                assert np.isfinite(message.descriptor).all()
            elif not isinstance(message.image, bytes):
                assert message.image is not None
                assert message.image.dtype == np.uint8
                assert message.image.ndim in (2, 3)
                assert message.image.size
            if message.calibration is not None:
                check_calibration(message.calibration)
        case RawFeatureMessage():
            assert len(message.model) <= 64
            if message.raw is not None:
                check_vector(message.raw)
        case FeatureMessage():
            assert len(message.model) <= 64
            assert message.odometry_m is None or 0 <= message.odometry_m < np.inf
            if message.descriptor is not None:
                check_vector(message.descriptor)
        case CandidatesMessage():
            assert message.rule in ("filter", "evidence", "ams")
            assert message.candidates
            for candidate in message.candidates:
                check_candidate(candidate)
            check_smoothed(message.smoothed)
        case FinishedMessage():
            assert message.rule in ("filter", "evidence", "ams")
            assert message.channels
            assert all(0 <= channel < 2**16 for channel in message.channels)
            check_smoothed(message.smoothed)
        case MatchMessage():
            assert -1 <= message.place < 2**31
            assert np.isfinite(message.score)
            assert all(0 <= channel < 2**16 for channel in message.missing)
            assert message.probability is None or 0 <= message.probability <= 1
            assert message.known in (None, False, True)
            assert message.too_fast in (False, True)
            assert message.pose is None or np.isfinite(message.pose).all()
            assert not isinstance(message, SmoothedMessage) or 0 <= message.lag < 2**31
            if isinstance(message, VerifiedMessage):
                check_verified(message)
        case HaloMessage():
            assert message.partials
            assert 0 <= message.shard < message.shards <= 2**16
            for part in message.partials:
                assert 0 <= part.channel < 2**16
                assert part.partial.dtype == np.float64
                assert part.partial.ndim == 1
                assert not np.isnan(part.partial).any()
        case MissingObservationMessage():
            assert message.reason in ("unreadable", "blank")
        case MomentsMessage():
            assert 0 < message.frames < np.inf
            assert message.sums.ndim == 2
            assert message.sums.dtype == np.float64
            assert np.isfinite(message.sums).all()
        case CacheQuery():
            assert 1 <= len(message.stream) <= 64
            assert 0 <= message.first < 2**48
            assert 0 <= message.end <= 2**49
        case OdometryMessage():
            assert 0 <= message.metres < np.inf
        case StatsMessage():
            assert len(message.service) <= 64
            assert all(isinstance(count, int) for count in message.counts.values())
        case _:
            raise AssertionError("a message whose bounds nobody has written down here")


def check_verified(message: VerifiedMessage) -> None:
    assert (message.reason is None) == (message.inliers is not None) == (message.ratio is not None)
    assert message.inliers is None or 0 <= message.inliers < 2**31
    assert message.ratio is None or 0 < message.ratio < np.inf
    if message.posterior is not None:
        assert message.posterior.dtype == np.float64
        assert message.posterior.shape == (240,)
        assert ((message.posterior >= 0) & (message.posterior <= 1.1)).all()
        assert message.posterior.sum() == pytest.approx(1)
    relative = message.relative
    if relative is None:
        return
    assert message.reason is None
    inverse = np.linalg.inv(relative.rotation)
    np.testing.assert_allclose(inverse, np.transpose(relative.rotation), atol=1e-5)
    assert np.linalg.norm(relative.direction) == pytest.approx(1)
    assert np.isfinite(relative.covariance).all()
    assert np.shape(relative.covariance) == (5, 5)
    for metres in (relative.distance_m, relative.deviation_m):
        assert metres is None or 0 < metres < np.inf


def check_calibration(calibration: Calibration) -> None:
    assert 8 <= calibration.width < 2**16
    assert 8 <= calibration.height < 2**16
    assert all(0 < focal <= 1e6 for focal in calibration.focal)
    assert all(abs(number) <= 1e6 for number in calibration.centre + calibration.distortion)
    assert len(calibration.distortion) in (0, 4, 5, 8, 12, 14)


def check_candidate(candidate: ChannelCandidate) -> None:
    assert 0 <= candidate.channel < 2**16
    assert -1 <= candidate.place < 2**31
    assert np.isfinite(candidate.score)
    assert 0 <= candidate.too_fast <= 1
    check_vector(candidate.evidence)
    assert candidate.places.dtype == np.int32
    assert candidate.places.ndim == 1


def check_smoothed(smoothed: SmoothedFrames | None) -> None:
    frames = [] if smoothed is None else list(smoothed.frames(2**48))
    for frame in frames:
        assert 2**48 - 2**31 < frame.sequence <= 2**48
        assert 0 <= frame.lag < 2**31
        check_candidate(ChannelCandidate.of(frame.channel, frame.candidate))
    if smoothed is not None:
        assert sum(len(frame.candidate.places) for frame in frames) == len(smoothed.places)
        assert sum(len(frame.candidate.evidence) for frame in frames) == len(smoothed.evidence)


def check_vector(vector: Any) -> None:
    assert vector.dtype == np.float32
    assert vector.ndim == 1
    assert np.isfinite(vector).all()


def test_every_kind_of_message_is_among_the_examples() -> None:
    def leaves(kind: type[Message]) -> set[type[Message]]:
        return set().union(*map(leaves, kind.__subclasses__())) or {kind}

    assert set(KINDS) >= {kind for kind in leaves(Message) if kind.__module__ in HOMES}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: type(example).__name__)
def test_every_example_is_within_bounds(example: Message) -> None:
    assert decode_or_refuse(type(example), example.encode()) is not None


@settings(max_examples=150)
@given(kinds, st.binary(max_size=80) | st.lists(pieces, max_size=30).map(b"".join))
def test_bytes_that_look_like_msgpack_are_refused_or_within_bounds(
    kind: type[Message], data: bytes
) -> None:
    decode_or_refuse(kind, data)


@settings(max_examples=120)
@given(st.sampled_from(EXAMPLES), st.data())
def test_a_message_of_the_right_keys_is_refused_or_within_bounds(
    example: Message, data: st.DataObject
) -> None:
    fields = msgpack.unpackb(example.encode())
    names = data.draw(st.sets(st.sampled_from(sorted(fields)), min_size=1))
    changes = {name: data.draw(values, label=name) for name in sorted(names)}
    decode_or_refuse(type(example), msgpack.packb(fields | changes))


@settings(max_examples=120)
@given(kinds, encoded_examples, encoded_examples, st.data())
def test_a_cut_flipped_and_spliced_message_is_refused_or_within_bounds(
    kind: type[Message], one: bytes, other: bytes, data: st.DataObject
) -> None:
    mutated = bytearray(one)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(mutated)))
        match data.draw(st.sampled_from(["flip", "cut", "splice", "insert", "repeat"])):
            case "flip" if at < len(mutated):
                mutated[at] ^= 1 << data.draw(st.integers(0, 7))
            case "cut":
                del mutated[at : at + data.draw(st.integers(1, 20))]
            case "splice":
                mutated[at:] = other[data.draw(st.integers(0, len(other))) :]
            case "insert":
                mutated[at:at] = data.draw(pieces)
            case "repeat":
                mutated[at:at] = mutated[at : at + data.draw(st.integers(1, 20))]
    decode_or_refuse(kind, bytes(mutated))


def a_list(length: int) -> bytes:
    return b"\xdd" + struct.pack(">I", length)


SIZE = 2**21
DEEP = a_list(255) + b"".join(b"\xa2%02x" % number for number in range(254))
GREEDY = {
    "a list of nothing": a_list(SIZE) + b"\xc0" * SIZE,
    "a list of mappings": a_list(SIZE) + b"\x80" * SIZE,
    "lists in lists": (b"\xdc\x00\xff" + b"\x90" * 255) * (SIZE // 258),
    "mappings in lists": (b"\xdc\x00\xff" + b"\x80" * 255) * (SIZE // 258),
    "numbers in lists": b"\x91" * 900 + a_list(SIZE // 9) + b"\xcb?\xf8\0\0\0\0\0\0" * (SIZE // 9),
    "texts, as deep as it goes": DEEP * (2**20 // len(DEEP)),
    "wide characters": b"\xdb" + struct.pack(">I", SIZE) + "\U0001f600".encode() * (SIZE // 4),
    "an extension": b"\xc9" + struct.pack(">Ib", SIZE, 5) + bytes(SIZE),
    "counts": msgpack.packb(
        {"version": 3, "service": "s", "counts": {str(n): "x" for n in range(SIZE // 8)}}
    ),
    "missing channels": msgpack.packb({"version": 3, "place": 0, "missing": ["x"] * (SIZE // 2)}),
    "axes": msgpack.packb(
        {"version": 3, "image": {"dtype": "uint8", "shape": [1] * SIZE, "data": b"x"}}
    ),
    "an image of no bytes": msgpack.packb(
        {"version": 3, "image": {"dtype": "uint8", "shape": [2**31, 2**31], "data": b""}}
    ),
    "a list that is declared": a_list(2**32 - 1),
    "bytes that are declared": b"\x81\xa5image\xc6\xff\xff\xff\xff",
}


@pytest.mark.parametrize("data", GREEDY.values(), ids=GREEDY.keys())
def test_no_message_takes_much_more_memory_than_it_is_long(data: bytes) -> None:
    for kind in (FrameMessage, MatchMessage, StatsMessage):
        tracemalloc.start()
        try:
            assert decode_or_refuse(kind, data) is None
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < 2 * len(data) + 20 * 2**20, kind
