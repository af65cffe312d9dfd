"""What a worker serves: channels of a map, whole or one shard of each, while the map stays."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import Map
from placefield.matching.channel_stage import ChannelStage, Compared
from placefield.matching.warm_up import warm_up
from placefield_services.channel_streams import ChannelOutputs, ChannelStream

Descriptor = NDArray[np.float32]
Comparing = Iterator[Callable[[], Compared | None]]
"""What returns how frames compare with the places, to be called in their order."""


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
        """Take the channels' numbers in a map, and which shard of how many.

        Raises:
            ConfigError: the map has too few places for so many shards.
        """
        self._channels = {number: placemap.channels[number] for number in channels}
        self._matching = matching
        self.digest = placemap.digest
        """Which map they are of."""
        places = placemap.places
        self._stage = ChannelStage(
            self._channels, matching, shard, shards, places.travelled, places.same
        )
        # Called before reading, for what was cut off would end the process, and again after.
        self._check_unchanged = placemap.check_unchanged
        self.needs_all = shards > 1
        """Whether no frame may be left out that others have taken."""

    def warm_up(self) -> None:
        """Match frames of no stream, so that what is made at its first use is made."""
        warm_up(self._channels.values(), self._matching)

    def new_stream(self, outputs: ChannelOutputs, first: int) -> ChannelStream:
        """Begin a stream with the frame of this number.

        Raises:
            MapError: somebody has written to the map meanwhile.
        """
        self._check_unchanged()
        return ChannelStream(self._stage, self._matching, self.digest, first, outputs)

    def comparing(self, descriptors: Sequence[Descriptor | None]) -> Comparing:
        """Yield what returns how each descriptor compares, None for a missing observation.

        Frames that come together are compared together. Not so those of shards, which may have to
        wait: each is compared when its turn has come.
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
        """Yield how each descriptor compares with the places, under each metric.

        Raises:
            MapError: somebody has written to the map meanwhile.
        """
        self._check_unchanged()
        for compared in self._stage.compare(descriptors):
            self._check_unchanged()
            yield compared


def _nothing() -> None:
    """Return how a missing observation compares."""
