"""Parsing of ROS messages by the definitions that a recording holds.

Only the types of the selected topics are parsed: a recording may hold other types that cannot be
parsed, such as service events.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

_SEPARATOR = "=" * 80 + "\n"


def full_name(kind: str) -> str:
    """Return the name of a type in ROS 2: sensor_msgs/Image becomes sensor_msgs/msg/Image."""
    package, slash, name = kind.partition("/")
    return f"{package}/msg/{name}" if slash and "/" not in name else kind


@lru_cache(maxsize=64)
def parser_of(kind: str, definition: str, *, is_idl: bool, is_ros1: bool) -> Callable[[bytes], Any]:
    """Return a parser of the messages of a type.

    Args:
        kind: its full name.
        definition: of the type and of its parts; empty: that of the latest ROS 2.
        is_idl: whether the definition is IDL, and not MSG.
        is_ros1: whether the messages are serialised by ROS 1, and not as CDR.
    """
    store = _typestore(kind, definition, is_idl)
    parse = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    return lambda data: parse(data, kind)


def _typestore(kind: str, definition: str, is_idl: bool) -> Typestore:
    if not definition.strip():  # a recording from before ROS 2 Iron
        return get_typestore(Stores.LATEST)
    store = get_typestore(Stores.EMPTY)
    if not is_idl:
        store.register(get_types_from_msg(definition, kind))
        return store
    texts = definition.split(_SEPARATOR)
    if len(texts) > 1:  # each follows a line with its name
        texts = [text.partition("\n")[2] for text in texts[1:]]
    for text in texts:
        store.register(get_types_from_idl(text))
    return store
