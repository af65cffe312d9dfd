"""Replaying a source of frames to the bus."""

import itertools
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from placefield.bus.keys import Keys
from placefield.bus.sending import FrameStream, sending
from placefield.bus.session import Bus
from placefield.config import Config
from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.common.progress import tracked
from placefield_tools.sources import Source
from placefield_tools.sources.source import until

_POLL_S = 0.1


@dataclass(frozen=True)
class Replayed:
    """The result of a replay.

    Attributes:
        sent: how many frames.
        unobserved: number of these frames without an observation, by reason: unreadable or blank.
    """

    sent: int
    unobserved: Mapping[str, int]


def replay(
    source: Source,
    bus: Bus,
    config: Config,
    stop: threading.Event,
    *,
    rate: float | None = None,
    loop: bool = False,
) -> Replayed:
    """Publish the frames of a source.

    A camera is live: frames are dropped if the services cannot keep up. Any other source is
    lossless: credits limit the frames in flight, and the call returns when all are answered.

    Args:
        source: of the frames.
        bus: to publish on.
        config: its run and bus are used.
        stop: ends the stream early.
        rate: most frames per second; a camera sends its newest. None: as fast as credits allow.
        loop: restart at the end, in the same stream.

    Raises:
        BusError: a service is missing, another replay is running, or the services stop answering.
        SourceError: the source fails.
    """
    keys = Keys(config.run)
    patience_s = config.bus.connect_timeout_s
    with sending(bus, keys, stop, live=source.live, patience_s=patience_s) as stream:
        frames = _frames(source, loop, stop)
        if rate is not None:
            frames = _newest(frames, rate) if source.live else _paced(stream, frames, rate, stop)
        try:
            with tracked(frames, "replaying", None if loop else source.count) as in_turn:
                for frame in in_turn:
                    if not stream.send(frame, stop):
                        break
        except SourceError:
            stream.end(stop)
            if not stop.is_set():  # a stopped source may fail because it has no frame yet
                raise
        stream.end(stop)
        return Replayed(stream.sent, stream.unobserved)


def _paced(
    stream: FrameStream, frames: Iterable[Frame], rate: float, stop: threading.Event
) -> Iterator[Frame]:
    """Yield frames at a rate, frames per second; time lost in a wait is not made up."""
    due = time.monotonic()
    for frame in frames:
        while (wait_s := due - time.monotonic()) > 0 and not stop.is_set():
            stop.wait(min(wait_s, _POLL_S))
            stream.look_after()
        due = _next_due(due, rate)
        yield frame


def _frames(source: Source, loop: bool, stop: threading.Event) -> Iterator[Frame]:
    """Return the frames, once or repeatedly until stopped."""
    return itertools.chain.from_iterable(
        until(stop, itertools.repeat(source)) if loop else (source,)
    )


def _newest(frames: Iterable[Frame], rate: float) -> Iterator[Frame]:
    """Yield a camera's newest frame at a rate, frames per second; the others are left out.

    The odometry of a frame that is left out is passed to the next frame.
    """
    due, odometry_m = time.monotonic(), None
    for frame in frames:
        odometry_m = odometry_m if frame.odometry_m is None else frame.odometry_m
        if time.monotonic() >= due:
            due = _next_due(due, rate)
            yield replace(frame, odometry_m=odometry_m)
            odometry_m = None


def _next_due(due: float, rate: float) -> float:
    return max(due, time.monotonic() - 1 / rate) + 1 / rate
