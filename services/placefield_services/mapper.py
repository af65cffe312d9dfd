"""The mapper: it keeps the frames of a drive that is explored, for the map and for workers.

It keeps one drive. The drive is over at the end of its stream, or when another stream begins.
"""

import logging
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from placefield.bus.connecting import open_bus
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Inbox, Received
from placefield.bus.message import Header
from placefield.bus.messages import CacheQuery, FeatureMessage, FrameMessage
from placefield.bus.replay_cache import Fetch, fetcher
from placefield.config import Config
from placefield.errors import FrameError
from placefield.features.calibration import Calibration, View
from placefield.features.images import small_jpeg
from placefield.features.raw_stage import raw_fingerprint
from placefield.features.rectification import image_of, view_of
from placefield.maps.drive_file import Drive, DriveFile, DriveFrame
from placefield.maps.traverse import THUMBNAIL
from placefield_services.background_query import BackgroundQuery
from placefield_services.frame_of_message import frame_of
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.whole_stream import StreamFrame, WholeStream

log = logging.getLogger(__name__)

SERVICE = "mapper"

_THUMBNAILS = 2 * WINDOW  # of frames that are not described yet
_NO_PICTURE = small_jpeg(np.zeros((8, 8), np.uint8), 8)


def run_mapper(
    path: Path, config: Config, camera: Calibration | None, stop: threading.Event
) -> None:
    """Keep the drive of a run in a file until ``stop`` is set.

    Args:
        path: of the map that will be built, see ``drive_path`` and ``ended_path``.
        config: its run, bus and feature count.
        camera: whose view the frames are rectified to; None: they are used as they are.
        stop: ends the service.

    Raises:
        ConfigError: a file of the network cannot be read, the camera has no view, or there are
            several runs.
        MapError: the file is of no drive, or another process explores it.
    """
    digest, run = raw_fingerprint(config.features.kind, camera), config.run
    view = None if camera is None else view_of(camera)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, [run])
        process.maps[run] = digest
        serve_metrics(config.monitoring, process.report)
        inbox = Inbox(process.counts)
        keys, counts = process.keys[run], process.counts[run]
        features = keys.cache(keys.feature)
        mapper = Mapper(path, digest, view, BackgroundQuery(fetcher(bus, features)), counts)
        bus.subscribe(keys.frame, inbox.offer, counts)
        bus.subscribe(keys.feature, inbox.offer, counts)
        bus.answer(features, lambda _, asked: mapper.reply(asked))

        def accept(received: Received) -> None:
            keep = mapper.keep_image if received.key == keys.frame else mapper.accept
            keep(received)

        with process.sole():
            process.serve(inbox, accept, stop)


def drive_path(path: Path) -> Path:
    """Return the path of the drive that will be the map at ``path``."""
    return path.with_name(f"{path.name}.drive")


def ended_path(path: Path) -> Path:
    """Return the path to which the drive moves when it is over."""
    return path.with_name(f"{path.name}.ended")


class Mapper:
    """Keeps the frames of one drive, in order.

    Counts the frames ``kept``, those ``left_out`` as they are of another drive or the disk is full,
    and those ``without_image`` among the kept.
    """

    def __init__(
        self, path: Path, digest: str, view: View | None, fetch: Fetch, counts: Counter[str]
    ) -> None:
        """Keep a drive for the map at ``path``, or go on with the one that is there.

        Args:
            path: of the map.
            digest: of the exploration.
            view: that the images are rectified to; None: they are used as they are.
            fetch: fetches the raw features of some frames from other services, or raises
                ``NotYet``.
            counts: of the run.

        Raises:
            MapError: the file is of no drive, or another process explores it.
        """
        self._path = path
        self._digest = digest
        self._view = view
        self._counts = counts
        self._stream = WholeStream(digest, fetch, self._begin, self._keep, counts)
        self._thumbnails: dict[tuple[str, int], bytes] = {}
        there = drive_path(path)
        self._file = DriveFile(there) if there.exists() else None
        self._is_growing = self._file is not None

    def keep_image(self, received: Received) -> None:
        """Keep the image of a frame until its feature comes, as a thumbnail; descriptors have none.

        Raises:
            MessageError: it is refused.
        """
        header = received.header
        if header.end:
            return
        message = FrameMessage.decode(received.payload)
        if message.image is None:
            return
        try:
            thumbnail = small_jpeg(image_of(frame_of(header, message), self._view), THUMBNAIL)
        except FrameError:
            return
        self._thumbnails[header.stream, header.sequence] = thumbnail
        if len(self._thumbnails) > _THUMBNAILS:
            del self._thumbnails[next(iter(self._thumbnails))]

    def accept(self, received: Received) -> None:
        """Handle the feature of a frame, missed ones first, or the end of a stream.

        Raises:
            MessageError: it is refused.
            NotYet: not all missed features have been fetched.
        """
        self._stream.accept(received.header, received.payload)

    def reply(self, asked: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield the features that a query for past ones asks for, and their headers.

        Raises:
            MessageError: ``asked`` is no ``CacheQuery``.
        """
        query = CacheQuery.decode(asked)
        file = self._file
        if file is None or query.stream != file.drive.stream:
            return
        for frame in file.frames(query.first, query.end):
            header = Header(
                stream=query.stream,
                sequence=frame.number,
                stamp_ns=frame.stamp_ns,
                live=file.drive.live,
            )
            feature = FeatureMessage(
                model=file.drive.feature, descriptor=frame.raw, odometry_m=frame.odometry_m
            )
            yield feature.encode(), header.encode()

    def _begin(self, header: Header) -> int:
        """Begin to keep a stream; return its first frame that is not kept."""
        if self._file is not None and self._file.drive.stream == header.stream:
            return self._file.next
        self._end()
        if ended_path(self._path).exists():
            log.warning(
                "stream %s is explored, but not kept: %s is made of the drive before it",
                header.stream[:8],
                self._path,
            )
            return header.sequence
        if self._file is not None:
            self._file.close()
            self._file = None
        drive = Drive(header.stream, header.live, self._digest)
        try:
            self._file = DriveFile(drive_path(self._path), drive)
        except OSError as error:
            log.error("%s; stream %s is explored, but not kept", error, header.stream[:8])
            return header.sequence
        self._is_growing = True
        return 0

    def _keep(self, frame: StreamFrame) -> None:
        header, feature = frame.header, frame.feature
        is_kept = self._file is not None and self._file.drive.stream == header.stream
        if feature is None:
            if is_kept:
                self._end()
            return
        if self._file is None or not is_kept or not self._is_growing:
            self._counts["left_out"] += 1
            return
        thumbnail = self._thumbnails.pop((header.stream, header.sequence), b"")
        if feature.descriptor is not None and not thumbnail:
            thumbnail = _NO_PICTURE
            self._counts["without_image"] += 1
        raw, metres = feature.descriptor, feature.odometry_m
        try:
            self._file.append(DriveFrame(header.sequence, header.stamp_ns, metres, raw, thumbnail))
        except OSError as error:
            self._is_growing = False
            self._counts["left_out"] += 1
            log.error("%s; the map will end before frame %d", error, header.sequence)
            return
        self._counts["kept"] += 1

    def _end(self) -> None:
        """Say that the drive is over, if there is one."""
        if self._file is not None and drive_path(self._path).exists():
            self._is_growing = False
            self._file.end(ended_path(self._path))
