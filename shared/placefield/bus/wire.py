"""Arrays and containers in messages: raw bytes with dtype and shape, and limits on the size."""

import itertools
from collections.abc import Mapping
from typing import Annotated, Any

import msgpack
import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator

# Large data come as bytes, so a message has few and short lists and mappings. Without these limits
# the message of an untrusted client could become objects of a hundred times its size.
_MOST_CONTAINERS = 512  # more than a message with the candidates of 64 channels has
_LIMITS = {"max_array_len": 256, "max_map_len": 256, "max_str_len": 1024, "max_ext_len": 0}

_DTYPES = {
    "uint8": np.uint8,
    "int32": np.int32,
    "float16": np.float16,
    "float32": np.float32,
    "float64": np.float64,
}
_NAMES = {np.dtype(kind): name for name, kind in _DTYPES.items()}


def pack(fields: Mapping[str, Any]) -> bytes:
    """Write the fields of a message as msgpack."""
    packed: bytes = msgpack.packb(fields, default=_to_wire)
    return packed


def _to_wire(value: Any) -> Mapping[str, Any]:
    """Return an array, or a part of a message, as fields."""
    if isinstance(value, np.ndarray):
        return {"dtype": _NAMES[value.dtype], "shape": value.shape, "data": value.tobytes()}
    fields: Mapping[str, Any] = vars(value)
    return fields


def unpack(data: bytes) -> Any:
    """Read msgpack from an untrusted client; bad data raise exceptions of many types."""
    numbers = itertools.count(1)

    def count(container: Any) -> Any:
        if next(numbers) > _MOST_CONTAINERS:
            raise ValueError(f"more than {_MOST_CONTAINERS} lists and mappings")
        return container

    return msgpack.unpackb(data, use_list=False, list_hook=count, object_hook=count, **_LIMITS)


def _array_from_wire(value: Any) -> NDArray[Any]:
    if isinstance(value, np.ndarray):
        return value
    try:
        shape = tuple(value["shape"])
        if not all(isinstance(size, int) and size >= 0 for size in shape):
            raise ValueError("negative or fractional size")
        return np.frombuffer(value["data"], _DTYPES[value["dtype"]]).reshape(shape)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"not an array: {error}") from None


def _float_vector(value: Any) -> NDArray[np.float32]:
    array = _array_from_wire(value)
    if array.dtype != np.float32 or array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError("expected a vector of finite float32")
    return array


def _descriptor(value: Any) -> NDArray[np.float16] | NDArray[np.float32]:
    array = _array_from_wire(value)
    if array.dtype not in (np.float16, np.float32) or array.ndim != 1 or not array.size:
        raise ValueError("expected a vector of float16 or float32")
    if not np.isfinite(array).all():
        raise ValueError("expected finite numbers")
    return array


def _sums(value: Any) -> NDArray[np.float64]:
    array = _array_from_wire(value)
    if array.dtype != np.float64 or array.ndim != 2 or not np.isfinite(array).all():
        raise ValueError("expected a matrix of finite float64")
    return array


def _number_vector(value: Any) -> NDArray[np.float64]:
    array = _array_from_wire(value)
    if array.dtype != np.float64 or array.ndim != 1 or np.isnan(array).any():
        raise ValueError("expected a vector of float64")
    return array


def _index_vector(value: Any) -> NDArray[np.int32]:
    array = _array_from_wire(value)
    if array.dtype != np.int32 or array.ndim != 1:
        raise ValueError("expected a vector of int32")
    return array


def _image(value: Any) -> bytes | NDArray[np.uint8]:
    """Return an encoded image as bytes, or its pixels, (H, W) or (H, W, 3) uint8."""
    if isinstance(value, bytes):
        return value
    array = _array_from_wire(value)
    if array.dtype != np.uint8 or array.ndim not in (2, 3) or array.size == 0:
        raise ValueError("expected encoded bytes or uint8 pixels")
    return array


FloatVector = Annotated[NDArray[np.float32], PlainValidator(_float_vector)]
Descriptor = Annotated[NDArray[np.float16] | NDArray[np.float32], PlainValidator(_descriptor)]
IndexVector = Annotated[NDArray[np.int32], PlainValidator(_index_vector)]
NumberVector = Annotated[NDArray[np.float64], PlainValidator(_number_vector)]
Sums = Annotated[NDArray[np.float64], PlainValidator(_sums)]
Image = Annotated[bytes | NDArray[np.uint8], PlainValidator(_image)]
