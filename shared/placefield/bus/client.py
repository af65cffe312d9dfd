"""The client for other programs: it publishes frames of a run and yields their matches."""

import logging
import threading
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from weakref import WeakSet

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.bus.matches import MatchQueue
from placefield.bus.sending import FrameStream, sending
from placefield.bus.session import Bus
from placefield.config import Config
from placefield.errors import MessageError
from placefield.features.frames import Frame
from placefield.features.images import Image, check_pixels, load
from placefield.fusion.match import Match
from placefield.loading import load_config
from placefield.matching.candidate import UNANSWERED

log = logging.getLogger(__name__)

_POLL_S = 0.1
_LAST_MATCH_S = 5.0  # after all frames have been answered
_LEAVE_S = 1.0


@contextmanager
def connect(
    endpoint: str | None = None, *, run: str | None = None, credentials: Path | str | None = None
) -> Iterator["Client"]:
    """Connect to the router at an endpoint, for the length of a ``with`` block.

    Args:
        endpoint: PROTOCOL/HOST:PORT of the router.
        run: the name of the run.
        credentials: folder with the credentials of a role, if the router requires them.

    Arguments that are not given come from the environment (``PLACEFIELD_BUS__ENDPOINT``, …) or from
    the defaults. A lost connection is restored by itself.

    Raises:
        ConfigError: a setting is malformed.
        BusError: no router answers there, or it refuses the credentials.
    """
    bus = {"endpoint": endpoint, "credentials": None if credentials is None else str(credentials)}
    given = {"bus": {name: value for name, value in bus.items() if value is not None}}
    config = load_config(None, given | ({} if run is None else {"runs": run}))
    keys = Keys(config.run)
    with open_bus(config.bus) as opened:
        client = Client(opened, keys, config)
        try:
            yield client
        finally:
            client.leave()


class Client:
    """Streams frames through the services of one run; ``connect`` makes one."""

    def __init__(self, bus: Bus, keys: Keys, config: Config) -> None:
        self._bus, self._keys, self._config = bus, keys, config
        self._streams = WeakSet[Generator[Match, None, None]]()

    def __repr__(self) -> str:
        return f"Client({self._config.bus.endpoint!r}, run={self._keys.run!r})"

    def stream(self, images: Iterable[Image | Frame], *, live: bool = False) -> Iterator[Match]:
        """Publish the frames of one drive, and yield the match of each frame as soon as it comes.

        A thread reads and sends the images meanwhile. There is one match for every frame, in order.
        Frames that are lost while a service or the router is away are sent again.

        Args:
            images: encoded images, pixels (H, W) or (H, W, 3) BGR uint8, or files, stamped with the
                current time; or frames with their own stamp and odometry.
            live: whether the services may drop frames when they are too slow, as for a camera,
                which does not wait. A dropped frame has a match with the place ``UNANSWERED``.

        Raises:
            BusError: a service is missing, the run has another source, or the services have not
                answered for 15 s.
            SourceError: a file cannot be read, or is no image. An exception of ``images`` is
                raised, too. The earlier frames have been matched by then.
            FrameError: pixels are of another shape or dtype.
        """
        stream = self._stream(images, live)
        self._streams.add(stream)
        return stream

    def leave(self) -> None:
        """End the streams that have not ended; ``connect`` calls this at the end of its block."""
        for stream in list(self._streams):
            stream.close()

    def _stream(self, images: Iterable[Image | Frame], live: bool) -> Generator[Match, None, None]:
        stop, patience_s = threading.Event(), self._config.bus.connect_timeout_s
        with (
            self._bus.scoped(),
            sending(self._bus, self._keys, stop, live=live, patience_s=patience_s) as frames,
        ):
            matches = MatchQueue(self._bus, self._keys)
            sender = _Sender(frames, images, stop)
            sender.start()
            try:
                yield from self._in_order(matches, frames, sender)
            finally:
                sender.leave()
            if sender.failure is not None:
                raise sender.failure

    def _in_order(
        self, matches: MatchQueue, frames: FrameStream, sender: "_Sender"
    ) -> Iterator[Match]:
        """Yield a match for each frame; it has the place ``UNANSWERED`` if the frame has none."""
        following, give_up_at = 0, None
        while give_up_at is None or time.monotonic() < give_up_at:
            if give_up_at is None and not sender.is_alive():
                give_up_at = time.monotonic() + (0 if frames.has_stalled else _LAST_MATCH_S)
            try:
                received = matches.get(_POLL_S)
            except MessageError as error:
                self._bus.log_dropped(self._keys.match, error)
                continue
            if received is None or received[0].stream != frames.name:
                continue
            header, message = received
            for _ in range(following, header.sequence):
                yield Match(UNANSWERED, 0.0)
            following = header.sequence
            if message is None:
                return
            yield message.match
            following += 1
        if not frames.has_stalled:
            log.warning("run %r: the services did not answer the stream's end", self._keys.run)
            for _ in range(following, frames.sent):
                yield Match(UNANSWERED, 0.0)


class _Sender(threading.Thread):
    """Sends images as the frames of a stream, and then the end of the stream."""

    def __init__(
        self, frames: FrameStream, images: Iterable[Image | Frame], stop: threading.Event
    ) -> None:
        super().__init__(daemon=True)  # the iterator of images may never yield the next one
        self._frames, self._images, self._ends = frames, images, stop
        self.failure: Exception | None = None
        """The error that stopped the sending; None: no error."""

    def run(self) -> None:
        """Send all images; an error in reading them ends the stream, too."""
        try:
            for image in self._images:
                if not self._frames.send(_frame(image), self._ends):
                    return
        except Exception as error:
            self.failure = error
        try:
            if self.failure is None or not self._frames.has_stalled:
                self._frames.end(self._ends)
        except Exception as error:
            self.failure = self.failure or error

    def leave(self) -> None:
        """End the stream, if it has not ended yet."""
        self._ends.set()
        self.join(_LEAVE_S)
        if not self._frames.has_ended:
            self._frames.end(self._ends)


def _frame(image: Image | Frame) -> Frame:
    if isinstance(image, Frame):
        return image
    shown = load(image)
    if not isinstance(shown, bytes):
        check_pixels(shown)
    return Frame(0, time.time_ns(), str(image) if isinstance(image, Path) else "", shown)
