"""The gateway to ROS 2: it streams the images of a topic, and publishes poses and diagnostics."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox, Received
from placefield.bus.message import Header
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.bus.ros_node import RosNode
from placefield.config import Config
from placefield.errors import ConfigError
from placefield.features.calibration import Calibration, View
from placefield.features.distance_sampler import DistanceSampler, check_spacing
from placefield.features.rectification import check_calibrated
from placefield.maps.map import Map
from placefield.ros.camera_info import (
    CAMERA_INFO,
    RECTIFIED,
    camera_info_topic,
    is_rectified,
)
from placefield.ros.ros_messages import COMPRESSED_IMAGE, DIAGNOSTICS, IMAGE, ODOMETRY, POSE
from placefield.ros.topic_keys import check_name, check_topic
from placefield_services.map_versions import MapVersions, PreparedVersions
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.ros_diagnostics import Diagnostics
from placefield_services.ros_poses import MapPoses, Poses
from placefield_services.ros_source import RosSource

log = logging.getLogger(__name__)

SERVICE = "replay"
"""The service name of every source of frames: a run has only one source."""

NAMESPACE = "/placefield"
"""Namespace of the ROS node; the node has the name of the run."""

_LIVE_IMAGES = 2  # images that may wait; older ones are dropped

# A newer image displaces an older one; all other messages are small, and are kept.
_IMAGE = Header(stream="ros", sequence=0, stamp_ns=0, live=True)
_OTHER = Header(stream="ros", sequence=0, stamp_ns=0)


@dataclass(frozen=True)
class Topics:
    """The ROS topics that the gateway subscribes to, and the camera of the images.

    Attributes:
        domain: the ROS domain.
        image: the topic of images.
        odometry: the topic of odometry; None: no odometry.
        spacing_m: use an image every so many metres by odometry; None: use every image.
        calibration: of the camera; None: if the map has a camera's view, that of the ``CameraInfo``
            beside the images.
    """

    domain: int
    image: str
    odometry: str | None = None
    spacing_m: float | None = None
    calibration: Calibration | None = None


@dataclass(frozen=True)
class _QueuedCall(Received):
    """A received message with the function that handles it."""

    handle: Callable[[], None]


def run_ros(
    versions: MapVersions | None, topics: Topics, config: Config, stop: threading.Event
) -> None:
    """Serve until ``stop`` is set, as the source of the run.

    Args:
        versions: of the map whose poses are published; None: no poses are published.
        topics: what the gateway subscribes to.
        config: its run and bus, and the tolerance of the poses, count.
        stop: ends the service.

    Raises:
        MapError: the map cannot be opened.
        BusError: the run has a source already.
        ConfigError: there are several runs, a name is not valid in ROS, a spacing has no odometry,
            the bus has credentials, or rosbags is missing.
        SourceError: the spacing is not a distance.
        FrameError: the camera does not fit the map's view.
    """
    if config.bus.credentials:
        raise ConfigError("--credentials: the ROS 2 gateway cannot use them; leave them out")
    spacing = None if topics.spacing_m is None else DistanceSampler(check_spacing(topics.spacing_m))
    if spacing is not None and topics.odometry is None:
        raise ConfigError("--spacing: needs odometry; give --odometry, too")
    run = check_name(config.run)
    for topic in filter(None, (topics.image, topics.odometry)):
        check_topic(topic)

    def prepare(placemap: Map) -> MapPoses:
        return MapPoses(placemap.places.poses, config.matching.tolerance, placemap.digest)

    opened = None if versions is None else versions.open()
    camera_topic = None if opened is None else _camera_topic(topics, opened.model.view)
    first = None if opened is None else prepare(opened)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, [run])
        serve_metrics(config.monitoring, process.report)
        keys, counts = process.keys[run], process.counts[run]
        inbox = Inbox(process.counts, live_capacity=_LIVE_IMAGES)
        node = RosNode(bus, topics.domain, NAMESPACE, run)

        frames = CachedPublisher(bus.publisher(keys.frame), ReplayCache(1))
        process.answers[run] = frames.cache
        put_odometry = partial(bus.put, keys.odometry)
        source = RosSource(frames, put_odometry, counts, spacing, topics.calibration)
        # As image_transport names topics. Each message says its own kind.
        kind = COMPRESSED_IMAGE if topics.image.endswith("/compressed") else IMAGE
        images = _offering(inbox, keys.frame, _IMAGE, source.publish_image)
        node.subscribe(topics.image, kind, images)
        if camera_topic is not None:
            cameras = _offering(inbox, keys.frame, _OTHER, source.receive_calibration)
            node.subscribe(camera_topic, CAMERA_INFO, cameras)
        if topics.odometry is not None:
            positions = _offering(inbox, keys.odometry, _OTHER, source.publish_odometry)
            node.subscribe(topics.odometry, ODOMETRY, positions)

        diagnostics = Diagnostics(run, node.publisher("/diagnostics", DIAGNOSTICS))
        stats = _offering(inbox, keys.all_stats, _OTHER, diagnostics.receive)
        bus.subscribe_raw(keys.all_stats, stats)
        followers: list[Poses] = []
        if first is not None and len(first.poses):
            for key, topic in ((keys.match, "pose"), (keys.smoothed, "smoothed_pose")):
                publisher = node.publisher(f"{NAMESPACE}/{run}/{topic}", POSE)
                poses = Poses(first, publisher, counts, smoothed=key == keys.smoothed)
                bus.subscribe(key, partial(_offer_match, inbox, poses), counts)
                followers.append(poses)
        else:
            why = "there is no map" if first is None else "the map has no poses"
            log.warning("%s, so no poses are published to ROS", why)

        prepared = None if versions is None else PreparedVersions(versions, prepare)

        def after_batch(run: str) -> None:
            for of_map in () if prepared is None else prepared.pop_all():
                for poses in followers:
                    poses.offer(of_map)
            diagnostics.publish()

        with process.sole():
            process.serve(inbox, _handle, stop, at_once=1, after_batch=after_batch)
            source.end()


def _camera_topic(topics: Topics, view: View | None) -> str | None:
    """Return the topic of the camera's calibration; None: it is known, or not needed.

    Raises:
        ConfigError: the images are rectified, so that this topic is not about them.
        FrameError: the known calibration does not fit the view.
    """
    if view is None or topics.calibration is not None:
        check_calibrated(topics.calibration, view)
        return None
    if is_rectified(topics.image):
        raise ConfigError(f"--topic {topics.image}: {RECTIFIED}")
    return camera_info_topic(topics.image)


def _offering(
    inbox: Inbox, key: str, header: Header, handle: Callable[[str, bytes], None]
) -> Callable[[str, bytes], None]:
    """Return a function that queues a received message, to be handled by ``handle`` in its turn."""

    def offer(about: str, payload: bytes) -> None:
        inbox.offer(_QueuedCall(key, header, payload, partial(handle, about, payload)))

    return offer


def _offer_match(inbox: Inbox, poses: Poses, match: Received) -> None:
    handle = partial(poses.publish, match.header, match.payload)
    inbox.offer(_QueuedCall(match.key, _OTHER, match.payload, handle))


def _handle(received: Received) -> None:
    assert isinstance(received, _QueuedCall)  # nothing else is offered
    received.handle()
