"""Recording the matches of a run, and its frames, into a file."""

import threading
from collections import Counter
from collections.abc import Callable, Container
from contextlib import AbstractContextManager, ExitStack

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import FrameMessage
from placefield.bus.refusing import count_refused
from placefield.bus.session import Bus
from placefield.bus.streams import StreamFollower, Turn
from placefield.config import Config
from placefield.errors import FrameError, MessageError
from placefield_tools.listen.match_queue import MatchQueue, warn_of_other_runs
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import kind_of
from placefield_tools.record.thumbnails import picture_of

_POLL_S = 0.1
_AT_ONCE = 16
_LIVE_FRAMES = 4  # queued at most: images are slow to write, and matches must not wait for them


def record(
    config: Config,
    into: AbstractContextManager[Recorder],
    stop: threading.Event,
    *,
    frames: bool = False,
    digests: Container[str] | None = None,
    ready: Callable[[], None] = lambda: None,
) -> Counter[str]:
    """Record the matches of all streams of a run, from now until ``stop`` is set.

    Messages that were received before ``stop`` are written.

    Args:
        config: its run and bus are used.
        into: the recorder; it is entered when the bus is open.
        stop: ends the recording.
        frames: whether to record the query frames, too.
        digests: of the maps that matches may be of; None: any map.
        ready: called when the recording has begun.

    Returns:
        The numbers of ``matches``, ``smoothed matches``, ``verified matches`` and ``frames`` that
        were written, and of those that were not, by reason.

    Raises:
        BusError: no router answers.
    """
    with ExitStack() as stack:
        with open_bus(config.bus, stop, viewer=True) as bus:
            warn_of_other_runs(bus, config.run)
            recorder = stack.enter_context(into)
            recording = RecordSession(
                bus, Keys(config.run), recorder, frames=frames, digests=digests
            )
            ready()
            while not stop.is_set():
                recording.write_received(_POLL_S)
        while recording.write_received(0):  # the bus is closed, so the queues become empty
            pass
    return recording.counts


class RecordSession:
    """Receives the matches of a run, and its frames if wanted, and writes them to a recorder.

    The image of a frame is written when the frame arrives, before its match.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        recorder: Recorder,
        *,
        frames: bool,
        digests: Container[str] | None = None,
    ) -> None:
        self._bus, self._keys, self._recorder = bus, keys, recorder
        self._written: Counter[str] = Counter()
        self._frame_counts: Counter[str] = Counter()
        self._follower = StreamFollower(self._frame_counts, lambda header: header.sequence)
        self._frames = Inbox({keys.run: self._frame_counts}, live_capacity=_LIVE_FRAMES)
        if frames:  # subscribed first, so that each match has its frame
            bus.subscribe(keys.frame, self._frames.offer, self._frame_counts)
        self._matches = MatchQueue(bus, keys, smoothed=True, verified=True, digests=digests)

    @property
    def counts(self) -> Counter[str]:
        """Numbers of what was written, and of what was not, by reason."""
        too_late = self._frame_counts["dropped_old"]
        lost = {
            "lost matches": self._matches.counts["gaps"],
            "malformed matches": self._matches.counts["malformed"],
            "matches of another map": self._matches.counts["other_map"],
            "matches of a stream that was left": self._matches.counts["stale"],
            # gaps also count the frames that came too late
            "lost frames": max(0, self._frame_counts["gaps"] - too_late),
            "frames too late for a picture": too_late,
            "frames for which there was no room": self._frame_counts["dropped_full"],
            "malformed frames": self._frame_counts["malformed"],
            "unreadable frames": self._frame_counts["unreadable"],
            "descriptors, which have no picture": self._frame_counts["without_image"],
        }
        return self._written + Counter(lost)

    def write_received(self, timeout: float) -> bool:
        """Write received messages, and wait ``timeout`` seconds for one; False if none came."""
        frames = self._frames.get_batch(0, _AT_ONCE)
        for received in frames:
            self._write_frame(received)
        has_match = self._write_match(0 if frames else timeout)
        while has_match and self._write_match(0):
            pass
        return bool(frames) or has_match

    def _write_match(self, timeout: float) -> bool:
        try:
            received = self._matches.get(timeout)
        except MessageError as error:
            count_refused(self._matches.counts, error)
            self._bus.log_dropped(self._keys.match, error)
            return True
        if received is not None:
            self._recorder.write_match(*received)
            kind = kind_of(received[1])
            what = "matches" if kind == "causal" else f"{kind} matches"
            self._written[what] += not received[0].end
        return received is not None

    def _write_frame(self, received: Received) -> None:
        """Write the image of a frame, once even if the frame was sent repeatedly."""
        header = received.header
        turn = self._follower.follow(header)
        if turn is Turn.AFTER_GAP:
            self._follower.skip_to(header.sequence)
        if header.end or turn not in (Turn.NEXT, Turn.AFTER_GAP):
            return
        try:
            picture = picture_of(FrameMessage.decode(received.payload))
        except MessageError as error:
            self._frame_counts["malformed"] += 1
            self._bus.log_dropped(received.key, error)
        except FrameError:
            self._frame_counts["unreadable"] += 1
        else:
            if picture is None:
                self._frame_counts["without_image"] += 1
                return
            self._recorder.write_frame(header, picture)
            self._written["frames"] += 1
