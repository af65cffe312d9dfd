"""The kinds of features, as the setting ``features.kind`` names them."""

import re
from collections.abc import Iterable
from typing import Annotated

from pydantic import AfterValidator
from pydantic_core import PydanticCustomError

ONNX = "onnx:"
"""Prefix of a network's file in a feature's kind."""

DESCRIPTOR = "descriptor"
"""The kind of feature of frames that are given descriptors, and no images."""

SIFT = "sift"
"""The kind of local features that need no network."""

FEATURES = ("grayscale", "gist", DESCRIPTOR)
"""The kinds of features that need neither a network nor another package."""

_PLUGIN = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,63}")

# Not each plus sign joins kinds, since the name of a network's file may have some.
_JOINED = re.compile(r"\+(?=onnx:|(?![^+]*\.onnx(?:\+|$))[A-Za-z][A-Za-z0-9_.-]*(?:\+|$))")


def kinds_of(kind: str) -> tuple[str, ...]:
    """Return the kinds of the parts of a feature, of ``gist+onnx:FILE`` ``gist`` and the other."""
    return tuple(_JOINED.split(kind))


def kind_of(kinds: Iterable[str]) -> str:
    """Return the kind of a feature by the kinds of its parts."""
    return "+".join(kinds)


def _check_kind(kind: str) -> str:
    kinds = kinds_of(kind)
    for part in kinds:
        is_network = part.startswith(ONNX) and len(part) > len(ONNX)
        if not is_network and not _PLUGIN.fullmatch(part):  # built-in kinds are such names, too
            choice = "give grayscale, gist, descriptor, onnx:FILE, or several as gist+onnx:FILE"
            raise PydanticCustomError("feature_kind", choice)
    if len(kinds) > 1 and DESCRIPTOR in kinds:
        raise PydanticCustomError("feature_kind", "descriptors are not joined with other features")
    if len(set(kinds)) < len(kinds):
        raise PydanticCustomError("feature_kind", "give each feature once")
    return kind


def _check_local_kind(kind: str) -> str:
    if kind != SIFT and not (kind.startswith(ONNX) and kind > ONNX):
        raise PydanticCustomError("local_feature_kind", "give sift, or onnx:FILE")
    return kind


FeatureKind = Annotated[str, AfterValidator(_check_kind)]

LocalFeatureKind = Annotated[str, AfterValidator(_check_local_kind)]
"""The kind of local features: ``sift``, or ``onnx:FILE``."""
