"""A source of frames onto the bus."""

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
    """What became of a replay.

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

    A camera is live: what the services cannot follow is dropped. Any other source is lossless: a
    frame is sent when one before it has been answered, and the end is awaited.

    Args:
        source: of the frames.
        bus: to publish on.
        config: its run and bus.
        stop: ends the stream early.
        rate: frames per second at most, of a camera the newest; None: as fast as credits allow.
        loop: begin again at the end, in the same stream.

    Raises:
        BusError: a service is missing, another replay is on, or the services stop answering.
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
            if not stop.is_set():  # else it may have been cut short before its first frame
                raise
        stream.end(stop)
        return Replayed(stream.sent, stream.unobserved)


def _paced(
    stream: FrameStream, frames: Iterable[Frame], rate: float, stop: threading.Event
) -> Iterator[Frame]:
    """Hand frames on at a rate of so many per second; no catching up after a wait."""
    due = time.monotonic()
    for frame in frames:
        while (wait_s := due - time.monotonic()) > 0 and not stop.is_set():
            stop.wait(min(wait_s, _POLL_S))
            stream.look_after()
        due = _next_due(due, rate)
        yield frame


def _frames(source: Source, loop: bool, stop: threading.Event) -> Iterator[Frame]:
    """Return the frames, once or until stopped."""
    return itertools.chain.from_iterable(
        until(stop, itertools.repeat(source)) if loop else (source,)
    )


def _newest(frames: Iterable[Frame], rate: float) -> Iterator[Frame]:
    """Hand on so many of a camera's frames per second, none late; those between are left out.

    Odometry that came with one that is left out goes with the next: it is still news.
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
