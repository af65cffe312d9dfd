"""MS: many scales, each fixed beforehand.

A reconstruction of Z. Chen, S. Lowry, A. Jacobson, M. E. Hasselmo and M. Milford, "Bio-inspired
homogeneous multi-scale place recognition", Neural Networks 72, 2015, from its description in the
AMS paper: there is one metric for each of several fixed scales; its segments all have that one
length, whatever the route is like, and overlap those of the others by an offset in time; matching
is as in AMS, under the rule ``ams``. The scales and offsets are our choice.
"""

from collections.abc import Sequence

import numpy as np

from placefield.errors import MapError
from placefield.scales.channels import Channel
from placefield.scales.encoding import encode

SCALES = (6, 12, 24, 48)

_CRISP = 1.0  # the fuzzifier at which a frame belongs to one cluster only
_MIN_SEGMENTS = 2  # with fewer, no place can be told from another


def fixed_scale_channels(places: int, scales: Sequence[int] = SCALES) -> tuple[Channel, ...]:
    """Cut a reference traverse twice per scale, the second time half a segment later.

    Frames left over at either end are inactive. Each channel matches at its own scale and, within
    that field, at the smallest scale of all, which is the map's shortest segment.

    Args:
        places: frames of the reference traverse.
        scales: lengths of the segments, each at least 2, frames.

    Raises:
        MapError: the reference is too short for two segments of a scale.
    """
    return tuple(_channel(places, scale, offset) for scale in scales for offset in (0, scale // 2))


def _channel(places: int, scale: int, offset: int) -> Channel:
    clusters = ((np.arange(places) + -offset % scale) // scale).astype(np.int32)
    encoding = encode(clusters, scale)
    if len(encoding.segments) < _MIN_SEGMENTS:
        raise MapError(
            f"the reference of {places} frames is too short for the fixed scale {scale}: give a "
            f"smaller scale, or at least {_MIN_SEGMENTS * scale + scale // 2} frames"
        )
    return Channel(_CRISP, clusters, encoding)
