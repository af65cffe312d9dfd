"""The channels of a map that a worker serves, whole or one shard of each."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import Map
from placefield.matching.channel_stage import ChannelStage, Compared
from placefield.matching.warm_up import warm_up
from placefield_services.channel_outputs import ChannelOutputs
from placefield_services.channel_streams import ChannelStream

Descriptor = NDArray[np.float32]
Comparing = Iterator[Callable[[], Compared | None]]
"""Functions that return the comparison of each frame with the places; call them in order."""


class ServedChannels:
    """The channels of a worker, or a shard of each."""

    def __init__(
        self,
        placemap: Map,
        channels: Sequence[int],
        matching: MatchingConfig,
        shard: int = 0,
        shards: int = 1,
    ) -> None:
        """Serve channels of a map.

        Args:
            placemap: the map.
            channels: numbers of the channels in the map.
            matching: the configuration of the matching.
            shard: number of the shard, from 0.
            shards: how many shards each channel has.

        Raises:
            ConfigError: the map has fewer places than shards.
        """
        self._channels = {number: placemap.channels[number] for number in channels}
        self._matching = matching
        self._topology = placemap.topology
        self.digest = placemap.digest
        """Digest of the map."""
        self.model = placemap.model
        """The descriptor model of the map."""
        self._stage = ChannelStage(self._channels, matching, shard, shards, self._topology)
        # Called before reading, because reading a truncated file kills the process, and after.
        self._check_unchanged = placemap.check_unchanged
        self.needs_all = shards > 1
        """Whether the worker must match every frame that the other shards match."""

    def warm_up(self) -> None:
        """Match frames of no stream, so that everything is loaded and compiled before serving."""
        warm_up(self._channels.values(), self._matching, self._topology)

    def new_stream(self, outputs: ChannelOutputs, first: int) -> ChannelStream:
        """Begin a stream with the frame of this number.

        Raises:
            MapError: the map's files have changed.
        """
        self._check_unchanged()
        return ChannelStream(self._stage, self._matching, self.digest, first, outputs)

    def comparing(self, descriptors: Sequence[Descriptor | None]) -> Comparing:
        """Yield for each descriptor a function that returns its comparison with the places.

        It returns None for a missing observation. The descriptors are compared in one batch. In a
        shard each descriptor is compared when it is due, because it may have to wait.
        """
        together = self._compare([one for one in descriptors if one is not None])
        for descriptor in descriptors:
            if descriptor is None:
                yield _nothing
            elif self.needs_all:
                yield partial(self._compare_one, descriptor)
            else:
                yield partial(next, together)

    def _compare_one(self, descriptor: Descriptor) -> Compared:
        return next(self._compare([descriptor]))

    def _compare(self, descriptors: Sequence[Descriptor]) -> Iterator[Compared]:
        """Yield the comparison of each descriptor with the places, under each metric.

        Raises:
            MapError: the map's files have changed.
        """
        self._check_unchanged()
        for compared in self._stage.compare(descriptors):
            self._check_unchanged()
            yield compared


def _nothing() -> None:
    """Return the comparison of a missing observation: None."""
