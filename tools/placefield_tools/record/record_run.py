"""What a run publishes, into a file."""

import threading
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import FrameMessage, SmoothedMessage
from placefield.bus.refusing import count_refused
from placefield.bus.session import Bus, open_bus
from placefield.bus.streams import StreamFollower, Turn
from placefield.config import Config
from placefield.errors import FrameError, MessageError
from placefield_tools.listen.match_queue import MatchQueue, warn_of_other_runs
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.thumbnails import small_jpeg

_POLL_S = 0.1
_AT_ONCE = 16
_LIVE_FRAMES = 4  # that may wait: pictures take longer than matches, which must not wait for them


def record(
    config: Config,
    into: AbstractContextManager[Recorder],
    stop: threading.Event,
    *,
    frames: bool = False,
    digest: str | None = None,
    ready: Callable[[], None] = lambda: None,
) -> Counter[str]:
    """Record the matches of a run from now on, of all its streams, until ``stop`` is set.

    What has come by then is written, too.

    Args:
        config: its run and bus.
        into: the recorder; entered once the bus is open.
        stop: ends it.
        frames: whether the query frames are recorded, too.
        digest: of the map that matches have to be of; None: that of the first of each stream.
        ready: called when nothing that comes is missed any more.

    Returns:
        How many ``matches``, ``smoothed matches`` and ``frames`` were written, and by the reason
        what could not be.

    Raises:
        BusError: no router answers.
    """
    with ExitStack() as stack:
        with open_bus(config.bus, stop, viewer=True) as bus:
            warn_of_other_runs(bus, config.run)
            recorder = stack.enter_context(into)
            recording = RecordSession(bus, Keys(config.run), recorder, frames=frames, digest=digest)
            ready()
            while not stop.is_set():
                recording.take(_POLL_S)
        while recording.take(0):  # nothing can come any more, so that this ends
            pass
    return recording.counts


class RecordSession:
    """The matches of a run, and its frames if they are wanted, as they come.

    A picture is written when its frame comes, which is before its match does.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        recorder: Recorder,
        *,
        frames: bool,
        digest: str | None = None,
    ) -> None:
        self._bus, self._keys, self._recorder = bus, keys, recorder
        self._written: Counter[str] = Counter()
        self._frame_counts: Counter[str] = Counter()
        self._follower = StreamFollower(self._frame_counts, lambda header: header.sequence)
        self._frames = Inbox({keys.run: self._frame_counts}, live_capacity=_LIVE_FRAMES)
        if frames:  # first: a match has its frame, then
            bus.subscribe(keys.frame, self._frames.offer, self._frame_counts)
        self._matches = MatchQueue(bus, keys, smoothed=True, digest=digest)

    @property
    def counts(self) -> Counter[str]:
        """What was written; matches and frames that were not, by the reason."""
        too_late = self._frame_counts["dropped_old"]
        lost = {
            "lost matches": self._matches.counts["gaps"],
            "malformed matches": self._matches.counts["malformed"],
            "matches of another map": self._matches.counts["other_map"],
            "matches of a stream that was left": self._matches.counts["stale"],
            "lost frames": max(0, self._frame_counts["gaps"] - too_late),  # which are gaps, too
            "frames too late for a picture": too_late,
            "frames for which there was no room": self._frame_counts["dropped_full"],
            "malformed frames": self._frame_counts["malformed"],
            "unreadable frames": self._frame_counts["unreadable"],
        }
        return self._written + Counter(lost)

    def take(self, timeout: float) -> bool:
        """Write what has come or comes in time; False if nothing did."""
        frames = self._frames.get_batch(0, _AT_ONCE)
        for received in frames:
            self._write_frame(received)
        has_match = self._take_match(0 if frames else timeout)
        while has_match and self._take_match(0):
            pass
        return bool(frames) or has_match

    def _take_match(self, timeout: float) -> bool:
        try:
            taken = self._matches.get(timeout)
        except MessageError as error:
            count_refused(self._matches.counts, error)
            self._bus.log_dropped(self._keys.match, error)
            return True
        if taken is not None:
            self._recorder.write_match(*taken)
            kind = "smoothed matches" if isinstance(taken[1], SmoothedMessage) else "matches"
            self._written[kind] += not taken[0].end
        return taken is not None

    def _write_frame(self, received: Received) -> None:
        """Write a picture of a frame, once however often it was sent."""
        header = received.header
        turn = self._follower.follow(header)
        if turn is Turn.AFTER_GAP:
            self._follower.skip_to(header.sequence)
        if header.end or turn not in (Turn.NEXT, Turn.AFTER_GAP):
            return
        try:
            picture = small_jpeg(FrameMessage.decode(received.payload).image)
        except MessageError as error:
            self._frame_counts["malformed"] += 1
            self._bus.log_dropped(received.key, error)
        except FrameError:
            self._frame_counts["unreadable"] += 1
        else:
            self._recorder.write_frame(header, picture)
            self._written["frames"] += 1
