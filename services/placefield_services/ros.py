"""The gateway to ROS 2: a topic's images in as a live stream; poses and diagnostics out."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from placefield.bus.inbox import Inbox, Received
from placefield.bus.message import Header
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.bus.ros import RosNode
from placefield.bus.session import open_bus
from placefield.config import Config
from placefield.errors import ConfigError
from placefield.features.distance_sampler import DistanceSampler, check_spacing
from placefield.maps.map import Map
from placefield.ros.keys import check_name, check_topic
from placefield.ros.messages import COMPRESSED_IMAGE, DIAGNOSTICS, IMAGE, ODOMETRY, POSE
from placefield_services.metrics import serve_metrics
from placefield_services.process import ServiceProcess
from placefield_services.ros_diagnostics import Diagnostics
from placefield_services.ros_poses import Poses
from placefield_services.ros_source import RosSource

log = logging.getLogger(__name__)

SERVICE = "replay"
"""Under which a run has one source of frames, whatever it is."""

NAMESPACE = "/placefield"
"""Of the node, which is named after the run."""

_LIVE_IMAGES = 2  # that may wait: older ones are dropped

# An image makes room for a newer one; all else is small, and is kept.
_IMAGE = Header(stream="ros", sequence=0, stamp_ns=0, live=True)
_OTHER = Header(stream="ros", sequence=0, stamp_ns=0)


@dataclass(frozen=True)
class Topics:
    """What is taken from ROS: its domain, and topics of it; none: no odometry.

    Images are taken every ``spacing_m`` metres by odometry; none: each one.
    """

    domain: int
    image: str
    odometry: str | None = None
    spacing_m: float | None = None


@dataclass(frozen=True)
class _Heard(Received):
    """A message, and what takes it."""

    take: Callable[[], None]


def run_ros(placemap: Map, topics: Topics, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set, as the source of the run.

    Raises:
        BusError: the run has a source already.
        ConfigError: there are several runs, a name is none for ROS, a spacing has no odometry, the
            bus asks for credentials, or rosbags is missing.
        SourceError: the spacing is no distance.
    """
    if config.bus.credentials:
        raise ConfigError("ROS 2 has no role on a bus with credentials; leave them out")
    spacing = None if topics.spacing_m is None else DistanceSampler(check_spacing(topics.spacing_m))
    if spacing is not None and topics.odometry is None:
        raise ConfigError("--spacing: goes by odometry; give --odometry, too")
    run = check_name(config.run)
    for topic in filter(None, (topics.image, topics.odometry)):
        check_topic(topic)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, [run])
        process.map = placemap.digest
        serve_metrics(config.monitoring, process.tell)
        keys, counts = process.keys[run], process.counts[run]
        inbox = Inbox(process.counts, live_capacity=_LIVE_IMAGES)
        node = RosNode(bus, topics.domain, NAMESPACE, run)

        frames = CachedPublisher(bus.publisher(keys.frame), ReplayCache(1))
        process.answers[run] = frames.cache
        source = RosSource(frames, partial(bus.put, keys.odometry), counts, spacing)
        # As image_transport names them. What comes says itself what it is.
        kind = COMPRESSED_IMAGE if topics.image.endswith("/compressed") else IMAGE
        images = _offering(inbox, keys.frame, _IMAGE, source.take_image)
        node.subscribe(topics.image, kind, images)
        if topics.odometry is not None:
            positions = _offering(inbox, keys.odometry, _OTHER, source.take_odometry)
            node.subscribe(topics.odometry, ODOMETRY, positions)

        diagnostics = Diagnostics(run, node.publisher("/diagnostics", DIAGNOSTICS))
        stats = _offering(inbox, keys.all_stats, _OTHER, diagnostics.take)
        bus.subscribe_raw(keys.all_stats, stats)
        if len(placemap.places.poses):
            of_map = placemap.places.poses, config.matching.tolerance, placemap.digest
            for key, topic in ((keys.match, "pose"), (keys.smoothed, "smoothed_pose")):
                publisher = node.publisher(f"{NAMESPACE}/{run}/{topic}", POSE)
                poses = Poses(*of_map, publisher, counts, smoothed=key == keys.smoothed)
                bus.subscribe(key, partial(_offer_match, inbox, poses), counts)
        else:
            log.warning("the map has no poses: none goes out to ROS")

        with process.sole():
            process.serve(
                inbox, _take, stop, at_once=1, after_batch=lambda _: diagnostics.publish()
            )
            source.end()


def _offering(
    inbox: Inbox, key: str, header: Header, take: Callable[[str, bytes], None]
) -> Callable[[str, bytes], None]:
    """Return what has a message taken from the inbox, in its turn, that the bus's thread hears."""

    def offer(about: str, payload: bytes) -> None:
        inbox.offer(_Heard(key, header, payload, partial(take, about, payload)))

    return offer


def _offer_match(inbox: Inbox, poses: Poses, match: Received) -> None:
    take = partial(poses.take, match.header, match.payload)
    inbox.offer(_Heard(match.key, _OTHER, match.payload, take))


def _take(heard: Received) -> None:
    assert isinstance(heard, _Heard)  # nothing else is offered
    heard.take()
