"""Messages that travel together: one sample on the bus has one message, or a bundle of several.

One message travels with its header as the attachment. The attachment of a bundle is the list of the
encoded headers, its payload the list of the payloads.
"""

from collections.abc import Sequence

import msgpack

from placefield.bus.message import MAX_BYTES, Header
from placefield.bus.wire import unpack
from placefield.errors import MessageError

MOST_TOGETHER = 64
"""The most messages of a bundle."""

WithHeader = tuple[Header, bytes]
"""The header and the payload of a message."""


def pack(messages: Sequence[WithHeader]) -> tuple[bytes, bytes]:
    """Return the attachment and the payload of a sample with one message, or with several."""
    headers = [header.encode() for header, _ in messages]
    payloads = [payload for _, payload in messages]
    if len(messages) == 1:
        return headers[0], payloads[0]
    return msgpack.packb(headers), msgpack.packb(payloads)


def unpack_all(attachment: bytes, payload: bytes) -> list[WithHeader]:
    """Return the messages of a sample, in order.

    Raises:
        MessageError: the sample is too large, a header is malformed, or a bundle has too many
            messages or not one payload for each header.
    """
    if len(payload) > MAX_BYTES:
        raise MessageError(f"{len(payload)} bytes, more than {MAX_BYTES}")
    if not _is_list(attachment):
        return [(Header.decode(attachment), payload)]
    headers, payloads = _byte_strings(attachment), _byte_strings(payload)
    if len(headers) != len(payloads):
        raise MessageError(f"a bundle of {len(headers)} headers and {len(payloads)} payloads")
    return list(zip(map(Header.decode, headers), payloads, strict=True))


def _is_list(packed: bytes) -> bool:
    """Whether the first byte is that of a list in msgpack; a header is a map."""
    return packed[:1] in (b"\xdc", b"\xdd") or 0x90 <= next(iter(packed), 0) <= 0x9F


def _byte_strings(packed: bytes) -> tuple[bytes, ...]:
    try:
        values = unpack(packed)
    except Exception as error:  # msgpack raises a dozen kinds
        raise MessageError(f"no bundle: {error or type(error).__name__}") from None
    if not isinstance(values, tuple) or not all(isinstance(value, bytes) for value in values):
        raise MessageError("no bundle: not a list of byte strings")
    if len(values) > MOST_TOGETHER:
        raise MessageError(f"a bundle of {len(values)} messages, more than {MOST_TOGETHER}")
    return values
