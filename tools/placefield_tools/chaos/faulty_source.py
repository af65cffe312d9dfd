"""A source that injects faults: each fault happens just before its frame."""

import itertools
from collections.abc import Callable, Iterator, Sequence

from placefield.features.frames import Frame
from placefield_tools.chaos.clock import Clock
from placefield_tools.chaos.schedule import Fault
from placefield_tools.chaos.verdict import Happened
from placefield_tools.sources import Source


class FaultySource(Source):
    """A number of frames of a repeated source, with faults between them."""

    live = False

    def __init__(
        self,
        source: Source,
        frames: int,
        faults: Sequence[Fault],
        begin: Callable[[Fault], None],
        end: Callable[[Fault], None],
        clock: Clock,
    ) -> None:
        """Call ``begin`` and ``end`` with each fault, on the thread that reads the frames."""
        self.count = self._frames = frames
        self.happened: list[Happened] = []
        self._source = source
        self._faults = faults
        self._begin = begin
        self._end = end
        self._clock = clock

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames."""
        for number, frame in enumerate(looped(self._source, self._frames)):
            for fault in self._faults:
                if fault.at == number:
                    self.happened.append(Happened(fault, number, self._clock.monotonic()))
                    self._begin(fault)
                if fault.at < fault.end == number:
                    self._end(fault)
            yield frame


def looped(source: Source, frames: int) -> Iterator[Frame]:
    """Yield so many frames of a source that is not live, and repeat it from its start."""
    return itertools.islice(itertools.chain.from_iterable(itertools.repeat(source)), frames)
