"""A check of an ONNX file before it is loaded, because it may come from an untrusted host.

The file is parsed by the encoding of Protocol Buffers alone
(https://protobuf.dev/programming-guides/encoding), with the field numbers of ``onnx.proto``.
"""

from collections.abc import Iterator, Mapping, Set

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError

MOST_BYTES = 2**30
"""The longest file of a network."""

MOST_NODES = 20_000
"""The most nodes of a network, in all its graphs; the largest image networks have thousands."""

_SHOWN = 60  # most characters of an operator's name in an error
_MOST_FIELDS = 1_000_000  # the most fields that are parsed; a node has about ten

_Operator = tuple[bytes, bytes]
"""Domain and name."""

# Sub-messages, by field number.
_Message = dict[int, "_Message"]
_TENSOR: _Message = {}
_SPARSE: _Message = {1: _TENSOR, 2: _TENSOR}
_ATTRIBUTE: _Message = {5: _TENSOR, 10: _TENSOR, 22: _SPARSE, 23: _SPARSE}
_NODE: _Message = {5: _ATTRIBUTE}
_GRAPH: _Message = {1: _NODE, 5: _TENSOR, 15: _SPARSE}
_ATTRIBUTE |= {6: _GRAPH, 11: _GRAPH}
_FUNCTION: _Message = {7: _NODE, 11: _ATTRIBUTE}
_MODEL: _Message = {7: _GRAPH, 20: {1: _GRAPH, 2: _GRAPH}, 25: _FUNCTION}

_EXTERNAL_DATA, _DATA_LOCATION = 13, 14  # fields of a tensor
_OF_NODE, _OF_FUNCTION = (7, 4), (10, 1)  # fields with the domain and the name of an operator
_STANDARD = (b"", b"ai.onnx")  # domains
_RUNTIMES_OWN = b"com.m"  # onnxruntime's domains, some of whose operators read files
_FIXED: Mapping[int, int] = {1: 8, 5: 4}  # length in bytes, by wire type


def check_onnx(name: str, onnx: NDArray[np.uint8]) -> None:
    """Refuse a network that reads other files, or is larger than any image network.

    Operators are those of the ONNX standard, and functions that the file itself defines.

    Args:
        name: of the network, used in messages.
        onnx: (bytes,) its file.

    Raises:
        ConfigError: the network is refused, or the bytes are no ONNX file.
    """
    if onnx.nbytes > MOST_BYTES:
        raise ConfigError(f"{name}: more than {MOST_BYTES} bytes; use a smaller network")
    view = np.ascontiguousarray(onnx).data.cast("B")
    waiting: list[tuple[_Message, memoryview]] = [(_MODEL, view)]
    called, defined = set[_Operator](), set[_Operator]()
    nodes = fields = 0
    while waiting:
        message, content = waiting.pop()
        nodes += message is _NODE
        texts: dict[int, bytes] = {}
        for number, value in _fields(name, content):
            fields += 1
            if nodes > MOST_NODES or fields > _MOST_FIELDS:
                raise ConfigError(
                    f"{name}: more than {MOST_NODES} nodes or {_MOST_FIELDS} fields; "
                    "use a smaller network"
                )
            if message is _TENSOR:
                _check_tensor(name, number, value)
            elif isinstance(value, memoryview) and number in message:
                waiting.append((message[number], value))
            elif isinstance(value, memoryview) and (message is _NODE or message is _FUNCTION):
                texts[number] = bytes(value)
        if message is _NODE:
            called.add(_operator(texts, _OF_NODE))
        elif message is _FUNCTION:
            defined.add(_operator(texts, _OF_FUNCTION))
    _check_operators(name, called, defined)


def _operator(texts: Mapping[int, bytes], numbers: tuple[int, int]) -> _Operator:
    domain, operator = (texts.get(number, b"") for number in numbers)
    return domain, operator


def _check_operators(name: str, called: Set[_Operator], defined: Set[_Operator]) -> None:
    own = {operator for operator in defined if not operator[0].startswith(_RUNTIMES_OWN)}
    for domain, operator in sorted(called - own):
        if domain not in _STANDARD:
            spelt = b".".join((domain, operator)).decode(errors="replace")
            raise ConfigError(
                f"{name}: operator {spelt[:_SHOWN]!r} is not of the ONNX standard; export the "
                "network without it"
            )


def _check_tensor(name: str, number: int, value: int | memoryview) -> None:
    if number == _EXTERNAL_DATA or (number == _DATA_LOCATION and value != 0):
        raise ConfigError(
            f"{name}: keeps data in other files, which are not read; "
            "save the network with all its data in one file"
        )


def _fields(name: str, content: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield the number and the value of each field of a message; integers, or slices of bytes."""
    at, end = 0, len(content)
    while at < end:
        tag, at = _varint(name, content, at)
        number, kind = tag >> 3, tag & 7
        value: int | memoryview
        if kind == 0:
            value, at = _varint(name, content, at)
        else:
            if kind == 2:
                length, at = _varint(name, content, at)
            elif kind in _FIXED:
                length = _FIXED[kind]
            else:
                raise _malformed(name)
            value = content[at : at + length]
            at += length
        if at > end or not 0 < number < 2**29:
            raise _malformed(name)
        yield number, value


def _varint(name: str, content: memoryview, at: int) -> tuple[int, int]:
    """Return a varint (7 bits per byte), and the offset after it."""
    value = 0
    for shift, byte in enumerate(content[at : at + 10]):
        value |= (byte & 127) << 7 * shift
        if byte < 128:
            return value, at + shift + 1
    raise _malformed(name)


def _malformed(name: str) -> ConfigError:
    return ConfigError(f"{name}: no network that onnxruntime can run: no ONNX file, or cut off")
