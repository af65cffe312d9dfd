from typing import Any, get_args

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from placefield.bus import message as message_module
from placefield.bus.candidate_messages import (
    CandidatesMessage,
    ChannelCandidate,
    ChannelPartial,
    HaloMessage,
    SmoothedFrame,
    SmoothedFrames,
)
from placefield.bus.message import Header, Message
from placefield.bus.messages import FeatureMessage, FrameMessage, MatchMessage, StatsMessage
from placefield.bus.wire import pack, unpack
from placefield.config import Rule
from placefield.errors import MessageError
from placefield.features.calibration import Calibration
from placefield.fusion.match import Match
from placefield.maps.digest import NO_DIGEST
from placefield.matching.candidate import NO_CANDIDATE, Candidate

finite = st.floats(allow_nan=False, allow_infinity=False)
vectors = hnp.arrays(
    np.float32,
    st.integers(0, 40),
    elements=st.floats(allow_nan=False, allow_infinity=False, width=32),
)
pixels = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(1, 9), st.integers(1, 9))
    | st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3)),
)
given_descriptors = hnp.arrays(
    st.sampled_from([np.float16, np.float32]),
    st.integers(1, 40),
    elements=st.floats(allow_nan=False, allow_infinity=False, width=16),
)
headers = st.builds(
    Header,
    stream=st.text(min_size=1, max_size=64),
    sequence=st.integers(0, 2**48 - 1),
    stamp_ns=st.integers(-(2**63), 2**63 - 1),
    live=st.booleans(),
    end=st.booleans(),
)
channel_candidates = st.builds(
    ChannelCandidate,
    channel=st.integers(0, 2**16 - 1),
    place=st.integers(-1, 2**31 - 1),
    score=finite,
    places=hnp.arrays(np.int32, st.integers(0, 40)),
    evidence=vectors,
    too_fast=st.floats(0, 1),
)
numbers = st.floats(-1e6, 1e6)
calibrations = st.builds(
    Calibration,
    model=st.just("fisheye"),
    width=st.integers(8, 2**16 - 1),
    height=st.integers(8, 2**16 - 1),
    focal=st.tuples(*[st.floats(1e-9, 1e6)] * 2),
    centre=st.tuples(numbers, numbers),
    distortion=st.tuples(*[numbers] * 4),
)
all_messages: st.SearchStrategy[Message] = st.one_of(
    headers,
    st.builds(FrameMessage, image=st.binary(max_size=200) | pixels),
    st.builds(FrameMessage, descriptor=given_descriptors),
    st.builds(FrameMessage, image=pixels, calibration=calibrations),
    st.builds(FeatureMessage, model=st.text(max_size=64), descriptor=st.none() | vectors),
    st.builds(
        CandidatesMessage,
        map=st.just(NO_DIGEST),
        rule=st.sampled_from(get_args(Rule)),
        candidates=st.lists(channel_candidates, min_size=1, max_size=3).map(tuple),
    ),
    st.builds(
        MatchMessage,
        map=st.just(NO_DIGEST),
        place=st.integers(-1, 2**31 - 1),
        score=finite,
        missing=st.lists(st.integers(0, 64)).map(tuple),
        too_fast=st.booleans(),
        pose=st.none() | st.tuples(finite, finite, finite),
    ),
    st.builds(
        StatsMessage,
        service=st.text(max_size=64),
        counts=st.dictionaries(st.text(), st.integers(0, 2**63)),
    ),
)
KINDS: list[type[Message]] = [
    Header,
    FrameMessage,
    FeatureMessage,
    CandidatesMessage,
    MatchMessage,
    StatsMessage,
]
plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=20)
    | st.binary(max_size=40),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=8) | st.binary(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)


def candidate(channel: int) -> ChannelCandidate:
    return ChannelCandidate(
        channel=channel,
        place=0,
        score=1.0,
        places=np.zeros(2, np.int32),
        evidence=np.ones(2, np.float32),
    )


def packed(value: Any) -> Any:
    """Write an array by hand as the page on the bus says."""
    if not isinstance(value, np.ndarray):
        return value
    return {"dtype": value.dtype.name, "shape": value.shape, "data": value.tobytes()}


def decode_or_refuse(kind: type[Message], data: bytes) -> Message | None:
    """Decode a message; a malformed one must raise a MessageError of one short line."""
    try:
        return kind.decode(data)
    except MessageError as error:
        message = str(error)
    assert len(message.splitlines()) == 1
    assert len(message) < 500
    return None


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return bool(
            isinstance(other, np.ndarray)
            and one.dtype == other.dtype
            and one.shape == other.shape
            and one.tobytes() == other.tobytes()
        )
    if isinstance(one, ChannelCandidate):
        return all(
            same(getattr(one, name), getattr(other, name)) for name in type(one).model_fields
        )
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


@given(all_messages)
def test_a_message_comes_back_as_it_was(message: Message) -> None:
    decoded = type(message).decode(message.encode())
    for name in type(message).model_fields:
        assert same(getattr(message, name), getattr(decoded, name)), name


@given(all_messages)
def test_a_message_that_names_no_version_is_refused(message: Message) -> None:
    fields = msgpack.unpackb(message.encode(), use_list=False)
    del fields["version"]
    assert decode_or_refuse(type(message), msgpack.packb(fields)) is None


@given(st.sampled_from(KINDS), st.binary(max_size=300))
def test_random_bytes_are_refused(kind: type[Message], data: bytes) -> None:
    assert decode_or_refuse(kind, data) is None


@given(st.sampled_from(KINDS), plain)
def test_random_msgpack_is_refused(kind: type[Message], value: Any) -> None:
    assert decode_or_refuse(kind, msgpack.packb(value)) is None


@given(all_messages, st.data())
def test_a_truncated_message_is_refused(message: Message, data: st.DataObject) -> None:
    encoded = message.encode()
    length = data.draw(st.integers(0, len(encoded) - 1))
    assert decode_or_refuse(type(message), encoded[:length]) is None


@given(all_messages, st.data())
def test_a_flipped_bit_gives_another_message_or_none(message: Message, data: st.DataObject) -> None:
    encoded = bytearray(message.encode())
    bit = data.draw(st.integers(0, 8 * len(encoded) - 1))
    encoded[bit // 8] ^= 1 << bit % 8
    decode_or_refuse(type(message), bytes(encoded))


@given(all_messages, plain, st.data())
def test_a_field_of_any_other_value_is_refused_or_fits(
    message: Message, value: Any, data: st.DataObject
) -> None:
    fields = msgpack.unpackb(message.encode())
    name = data.draw(st.sampled_from(sorted(fields)))
    decoded = decode_or_refuse(type(message), msgpack.packb(fields | {name: value}))
    descriptor = getattr(decoded, "descriptor", None)
    if descriptor is not None:
        assert descriptor.ndim == 1
        assert np.isfinite(descriptor).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_of_another_kind_is_refused(kind: type[Message]) -> None:
    examples: list[Message] = [
        Header(stream="s", sequence=0, stamp_ns=0),
        FrameMessage(image=b"image"),
        FeatureMessage(model="m", descriptor=None),
        CandidatesMessage(map=NO_DIGEST, rule="evidence", candidates=(candidate(0),)),
        MatchMessage(map=NO_DIGEST, place=0, score=0.0),
        StatsMessage(service="s", counts={}),
    ]
    decoded = [decode_or_refuse(kind, example.encode()) for example in examples]
    assert [type(message) for message in decoded if message is not None] == [kind]


@pytest.mark.parametrize("version", [0, 1, 2, 4, -1, "3", None, 1.5, 2**40])
def test_another_version_is_refused_by_name(version: Any) -> None:
    fields = msgpack.unpackb(Header(stream="s", sequence=0, stamp_ns=0).encode())
    with pytest.raises(MessageError, match="version"):
        Header.decode(msgpack.packb(fields | {"version": version}))


def wire(**changes: Any) -> dict[str, Any]:
    array = {"dtype": "float32", "shape": (2,), "data": np.ones(2, np.float32).tobytes()}
    return array | changes


@pytest.mark.parametrize(
    "array",
    [
        wire(shape=(2**20, 2**20)),
        wire(shape=(2**40,) * 40),
        wire(shape=(2**63,)),
        wire(shape=(2**64 - 1, 0)),
        wire(shape=(-1,)),
        wire(shape=(2, -1)),
        wire(shape=(2.0,)),
        wire(shape=(1, 2)),
        wire(shape=2),
        wire(shape="2"),
        wire(shape=()),
        wire(dtype="float64", shape=(1,)),
        wire(dtype="uint8", shape=(8,)),
        wire(dtype="object"),
        wire(dtype=["float32"]),
        wire(data=b"\0" * 7),
        wire(data="text"),
        wire(data=np.array([1, np.nan], np.float32).tobytes()),
        wire(data=np.array([np.inf, 1], np.float32).tobytes()),
        {"dtype": "float32"},
        [1.0, 2.0],
        "vector",
        3,
    ],
)
def test_a_descriptor_that_is_no_finite_vector_is_refused(array: Any) -> None:
    packed = msgpack.packb({"version": 3, "model": "m", "descriptor": array})
    with pytest.raises(MessageError, match="FeatureMessage"):
        FeatureMessage.decode(packed)


@pytest.mark.parametrize(
    "message", [FrameMessage(image=b"image"), FeatureMessage(model="m", descriptor=None)]
)
def test_odometry_is_none_or_a_distance(message: Message) -> None:
    fields = msgpack.unpackb(message.encode())
    for right in (None, 0, 0.0, 12.5, 1e300):
        decoded = decode_or_refuse(type(message), msgpack.packb(fields | {"odometry_m": right}))
        assert getattr(decoded, "odometry_m", "refused") == right
    for wrong in (-1e-9, np.nan, np.inf, -np.inf, "1", b"1", True, [1.0]):
        packed = msgpack.packb(fields | {"odometry_m": wrong})
        with pytest.raises(MessageError, match="odometry_m"):
            type(message).decode(packed)


@pytest.mark.parametrize("places", [wire(), wire(dtype="int32", shape=(1, 2)), [1, 2], None])
def test_places_that_are_no_vector_of_indices_are_refused(places: Any) -> None:
    fields = msgpack.unpackb(
        CandidatesMessage(
            map=NO_DIGEST, rule="filter", candidates=(candidate(0), candidate(1))
        ).encode()
    )
    fields["candidates"][1]["places"] = places
    with pytest.raises(MessageError, match=r"CandidatesMessage: 'candidates.1.places'"):
        CandidatesMessage.decode(msgpack.packb(fields))


def test_a_message_has_room_for_64_channels_and_is_of_one_at_least() -> None:
    full = CandidatesMessage(
        map=NO_DIGEST, rule="filter", candidates=tuple(map(candidate, range(64)))
    )
    assert same(CandidatesMessage.decode(full.encode()).candidates, full.candidates)
    fields = msgpack.unpackb(full.encode()) | {"candidates": []}
    with pytest.raises(MessageError, match="candidates"):
        CandidatesMessage.decode(msgpack.packb(fields))


@pytest.mark.parametrize("shape", [(0, 4), (8,), (1, 2, 2, 2), (2, 2, 2, 1), ()])
def test_pixels_that_make_no_image_are_refused(shape: tuple[int, ...]) -> None:
    data = bytes(int(np.prod(shape)))
    packed = msgpack.packb(
        {"version": 3, "image": {"dtype": "uint8", "shape": shape, "data": data}}
    )
    with pytest.raises(MessageError, match="image"):
        FrameMessage.decode(packed)


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"image": b"x", "descriptor": np.ones(4, np.float32)},
        {"descriptor": np.ones((1, 4), np.float32)},
        {"descriptor": np.ones(0, np.float32)},
        {"descriptor": np.ones(4, np.float64)},
        {"descriptor": np.array([1, np.inf], np.float16)},
    ],
)
def test_a_frame_is_an_image_or_a_finite_vector(content: dict[str, Any]) -> None:
    sent = {name: packed(value) for name, value in content.items()}
    with pytest.raises(MessageError, match="FrameMessage"):
        FrameMessage.decode(msgpack.packb({"version": 3, **sent}))


@pytest.mark.parametrize("score", [float("nan"), float("inf"), -float("inf"), "0", None, True])
def test_a_score_that_is_no_finite_number_is_refused(score: Any) -> None:
    fields = msgpack.unpackb(MatchMessage(map=NO_DIGEST, place=0, score=0.0).encode())
    assert decode_or_refuse(MatchMessage, msgpack.packb(fields | {"score": score})) is None


def test_a_candidate_and_a_match_that_are_too_fast_come_back_so() -> None:
    places, evidence = np.arange(2, dtype=np.int32), np.zeros(2, np.float32)
    sent = Candidate(1, 0.25, places, evidence, too_fast=0.625)
    assert ChannelCandidate.of(3, sent).candidate == sent
    match = Match(7, -2.0, (), 0.125, known=False, too_fast=True)
    sent = MatchMessage.of(match, map=NO_DIGEST)
    assert MatchMessage.decode(sent.encode()).match == match


def test_smoothed_frames_come_back_with_how_likely_each_is_too_fast() -> None:
    places, evidence = np.arange(2, dtype=np.int32), np.zeros(2, np.float32)
    sent = [0.0, 0.625, 1.0]
    smoothed = [
        SmoothedFrame(2, 5, 4, Candidate(1, 0.25, places, evidence, posterior))
        for posterior in sent
    ]
    packed = SmoothedFrames.of(9, [*smoothed, SmoothedFrame(3, 5, 4, NO_CANDIDATE)])
    assert packed is not None
    unpacked = SmoothedFrames.model_validate(unpack(pack(vars(packed))))
    assert [frame.candidate.too_fast for frame in unpacked.frames(9)] == [*sent, 0.0]


def test_a_message_that_does_not_say_whether_it_is_too_fast_is_not() -> None:
    fields = msgpack.unpackb(MatchMessage(map=NO_DIGEST, place=0, score=0.0).encode())
    del fields["too_fast"]
    assert MatchMessage.decode(msgpack.packb(fields)).too_fast is False
    message = CandidatesMessage(map=NO_DIGEST, rule="filter", candidates=(candidate(0),))
    fields = msgpack.unpackb(message.encode())
    del fields["candidates"][0]["too_fast"]
    assert CandidatesMessage.decode(msgpack.packb(fields)).candidates[0].too_fast == 0


@pytest.mark.parametrize("posterior", [-0.01, 1.01, float("nan"), float("inf"), "0", None, True])
def test_a_posterior_that_is_none_is_refused(posterior: Any) -> None:
    message = CandidatesMessage(map=NO_DIGEST, rule="filter", candidates=(candidate(0),))
    fields = msgpack.unpackb(message.encode())
    fields["candidates"][0]["too_fast"] = posterior
    with pytest.raises(MessageError, match="too_fast"):
        CandidatesMessage.decode(msgpack.packb(fields))


@pytest.mark.parametrize("posterior", [-0.01, 1.01, float("nan"), float("inf")])
def test_a_posterior_of_a_smoothed_frame_that_is_none_is_refused(posterior: float) -> None:
    packed = SmoothedFrames.of(9, [SmoothedFrame(3, 5, 4, NO_CANDIDATE)])
    message = CandidatesMessage(
        map=NO_DIGEST, rule="filter", candidates=(candidate(0),), smoothed=packed
    )
    fields = msgpack.unpackb(message.encode())
    fields["smoothed"]["too_fast"]["data"] = np.float64(posterior).tobytes()
    with pytest.raises(MessageError, match="smoothed"):
        CandidatesMessage.decode(msgpack.packb(fields))


def test_a_message_nested_too_deeply_is_refused() -> None:
    for kind in KINDS:
        assert decode_or_refuse(kind, b"\x91" * 100_000) is None
        assert decode_or_refuse(kind, b"\x81\xa1x" * 100_000) is None


def test_a_message_that_is_too_large_is_refused_unread(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded = FrameMessage(image=bytes(200)).encode()
    monkeypatch.setattr(message_module, "MAX_BYTES", len(encoded) - 1)
    with pytest.raises(MessageError, match=f"more than {len(encoded) - 1}"):
        FrameMessage.decode(encoded)


def test_a_field_name_of_an_untrusted_client_can_forge_no_log_line() -> None:
    name = "x\nplacefield: all is well" + "!" * 10_000
    fields = msgpack.unpackb(Header(stream="s", sequence=0, stamp_ns=0).encode())
    assert decode_or_refuse(Header, msgpack.packb(fields | {name: 1})) is None


def test_a_shard_that_does_not_exist_is_refused() -> None:
    partial = ChannelPartial(channel=0, partial=np.zeros(1))
    message = HaloMessage.model_construct(
        map=NO_DIGEST, shard=3, shards=3, partials=(partial,), version=3
    )
    with pytest.raises(MessageError, match="not below the number of shards"):
        HaloMessage.decode(message.encode())


def test_a_header_awaits_no_answer_of_a_later_frame() -> None:
    honest = Header(stream="s", sequence=7, stamp_ns=0, oldest=7)
    forged = honest.model_copy(update={"oldest": 8})
    assert Header.decode(honest.encode()) == honest
    with pytest.raises(MessageError, match="later than this frame"):
        Header.decode(forged.encode())
    assert Header.decode(honest.of_frame(3).encode()).oldest == 3
