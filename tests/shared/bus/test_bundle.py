"""One message in a sample, or several: as documented, or refused as a whole."""

import msgpack
import pytest

from placefield.bus.bundle import MOST_TOGETHER, WithHeader, pack, unpack_all
from placefield.bus.message import Header
from placefield.errors import MessageError


def messages(count: int) -> list[WithHeader]:
    return [(header(sequence), b"payload %d" % sequence) for sequence in range(count)]


def header(sequence: int) -> Header:
    return Header(stream="s", sequence=sequence, stamp_ns=0)


def test_one_message_travels_with_its_header_as_the_attachment() -> None:
    assert pack(messages(1)) == (header(0).encode(), b"payload 0")


def test_several_messages_are_a_list_of_headers_and_a_list_of_payloads() -> None:
    attachment, payload = pack(messages(2))
    assert msgpack.unpackb(attachment) == [header(0).encode(), header(1).encode()]
    assert msgpack.unpackb(payload) == [b"payload 0", b"payload 1"]


@pytest.mark.parametrize("count", [1, 2, 15, 16, MOST_TOGETHER])
def test_messages_come_back_as_they_were(count: int) -> None:
    assert unpack_all(*pack(messages(count))) == messages(count)


HEADERS, PAYLOADS = pack(messages(3))


@pytest.mark.parametrize(
    ("attachment", "payload"),
    [
        (HEADERS, msgpack.packb([b"one", b"two"])),
        (HEADERS, b"no list"),
        (HEADERS, msgpack.packb({"a": b"map"})),
        (HEADERS, msgpack.packb(["texts", "for", "bytes"])),
        (HEADERS, PAYLOADS[:-1]),
        (HEADERS, b""),
        (msgpack.packb([header(0).encode(), b"no header"]), msgpack.packb([b"", b""])),
        (msgpack.packb([header(0).model_dump()]), msgpack.packb([b""])),
        (HEADERS[:-1], PAYLOADS),
        (b"\xdd\xff\xff\xff\xff", PAYLOADS),
        pack(messages(MOST_TOGETHER + 1)),
        (b"", b""),
    ],
)
def test_a_bundle_that_is_not_as_documented_is_refused_as_a_whole(
    attachment: bytes, payload: bytes
) -> None:
    with pytest.raises(MessageError) as refused:
        unpack_all(attachment, payload)
    assert len(str(refused.value)) < 200
