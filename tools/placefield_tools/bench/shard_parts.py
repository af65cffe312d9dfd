"""What a frame costs in a channel that is divided into shards, part by part, in one process."""

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from placefield.bus.candidate_messages import ChannelPartial, HaloMessage
from placefield.config import Config
from placefield.maps.map import MapChannel
from placefield.matching.channel_stage import ChannelStage, StreamMatcher
from placefield.matching.matcher import Partial
from placefield_tools.bench.figure import Figure

SHARDS = (1, 2, 4, 8)

_WARM_UP = 10  # frames, until the belief is where the vehicle is
_MAP = "0" * 16  # the digest of any map

Result = TypeVar("Result")


def shard_parts(channel: MapChannel, query: Sequence[NDArray[np.float32]]) -> list[Figure]:
    """Measure the parts of a frame of one channel, median of all frames of a query.

    Args:
        channel: of the whole map.
        query: descriptors (N,), more than are needed to warm up.
    """
    return [figure for shards in SHARDS for figure in _parts_of(channel, query, shards)]


def _parts_of(
    channel: MapChannel, query: Sequence[NDArray[np.float32]], shards: int
) -> list[Figure]:
    stages = [ChannelStage({0: channel}, Config().matching, own, shards) for own in range(shards)]
    streams = [stage.new_stream() for stage in stages]
    taken = []
    for number, descriptor in enumerate(query):
        local_s, partials = [], []
        for stage, stream in zip(stages, streams, strict=True):
            seconds, partial = _timed(_partial_of, stage, stream, descriptor, number)
            local_s.append(seconds)
            partials.append(partial)
        halo_s, _ = _timed(_sent_and_received, partials[0], shards)
        reduce_s = [_timed(stream.reduce, {0: partials})[0] for stream in streams]
        taken.append((max(local_s), max(reduce_s), halo_s))
    local_ms, reduce_ms, halo_ms = 1e3 * np.median(taken[_WARM_UP:], axis=0)
    of = f"of {shards} shards of a channel"
    return [
        Figure(f"shard_local_ms_{shards}", local_ms, f"the slowest {of}: compare and predict"),
        Figure(f"shard_reduce_ms_{shards}", reduce_ms, f"the slowest {of}: reduce"),
        Figure(f"shard_halo_ms_{shards}", halo_ms, f"one {of}: encode and decode a halo"),
    ]


def _partial_of(
    stage: ChannelStage, stream: StreamMatcher, descriptor: NDArray[np.float32], number: int
) -> Partial:
    """Return the partial result of a shard for a frame, see ``StreamMatcher.local``."""
    (compared,) = stage.compare([descriptor])
    return stream.local(compared, number)[0]


def _sent_and_received(partial: Partial, shards: int) -> HaloMessage:
    """Return the message of a partial result as another shard receives it."""
    partials = (ChannelPartial(channel=0, partial=partial),)
    message = HaloMessage(map=_MAP, shard=0, shards=shards, partials=partials)
    return HaloMessage.decode(message.encode())


def _timed(work: Callable[..., Result], *given: object) -> tuple[float, Result]:
    """Return the processor time of some work, and its result."""
    start = time.process_time()
    result = work(*given)
    return time.process_time() - start, result
