"""Placefield: visual place recognition with adaptive multiple scales.

A program that has frames at hand needs five lines::

    from placefield import Recognizer, build_map

    recognizer = Recognizer(build_map(reference_images))
    for image in camera:
        print(recognizer.update(image))

Services on a bus recognise the same places::

    with placefield.connect("tcp/127.0.0.1:7557") as client:
        for match in client.stream(camera):
            print(match)

``placefield_tools.sources.open_source`` gives the frames of folders, videos, recordings, cameras.
"""

import os
from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from placefield.bus.client import Client, connect
    from placefield.config import Config, MatchingConfig
    from placefield.errors import (
        BusError,
        ConfigError,
        FrameError,
        MapError,
        MessageError,
        OtherMapError,
        PlacefieldError,
        SourceError,
        TruthError,
    )
    from placefield.evaluation.curves import PrecisionRecall, precision_recall
    from placefield.evaluation.truth import Truth, read_truth
    from placefield.features.calibration import Calibration
    from placefield.features.camera_file import read_camera
    from placefield.features.describer import Describer
    from placefield.features.feature_check import check_feature
    from placefield.features.frames import Frame
    from placefield.fusion.match import Match, SmoothedMatch
    from placefield.library import build_map
    from placefield.loading import load_config
    from placefield.maps.map import Map
    from placefield.maps.opening import open_map
    from placefield.maps.store import save_map
    from placefield.matching.candidate import UNANSWERED
    from placefield.pose import Pose
    from placefield.recognizer import Recognizer

__version__ = version("placefield")

__all__ = (
    "UNANSWERED",
    "BusError",
    "Calibration",
    "Client",
    "Config",
    "ConfigError",
    "Describer",
    "Frame",
    "FrameError",
    "Map",
    "MapError",
    "Match",
    "MatchingConfig",
    "MessageError",
    "OtherMapError",
    "PlacefieldError",
    "Pose",
    "PrecisionRecall",
    "Recognizer",
    "SmoothedMatch",
    "SourceError",
    "Truth",
    "TruthError",
    "build_map",
    "check_feature",
    "connect",
    "load_config",
    "open_map",
    "precision_recall",
    "read_camera",
    "read_truth",
    "save_map",
)

# OpenCV reads this when it is loaded: a small file may claim to be a huge image, and it would make
# room for that before anyone can say no.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "64000000")

_HOMES = {
    "UNANSWERED": "placefield.matching.candidate",
    "BusError": "placefield.errors",
    "Calibration": "placefield.features.calibration",
    "Client": "placefield.bus.client",
    "Config": "placefield.config",
    "ConfigError": "placefield.errors",
    "Describer": "placefield.features.describer",
    "Frame": "placefield.features.frames",
    "FrameError": "placefield.errors",
    "Map": "placefield.maps.map",
    "MapError": "placefield.errors",
    "Match": "placefield.fusion.match",
    "MatchingConfig": "placefield.config",
    "MessageError": "placefield.errors",
    "OtherMapError": "placefield.errors",
    "PlacefieldError": "placefield.errors",
    "Pose": "placefield.pose",
    "PrecisionRecall": "placefield.evaluation.curves",
    "Recognizer": "placefield.recognizer",
    "SmoothedMatch": "placefield.fusion.match",
    "SourceError": "placefield.errors",
    "Truth": "placefield.evaluation.truth",
    "TruthError": "placefield.errors",
    "build_map": "placefield.library",
    "check_feature": "placefield.features.feature_check",
    "connect": "placefield.bus.client",
    "load_config": "placefield.loading",
    "open_map": "placefield.maps.opening",
    "precision_recall": "placefield.evaluation.curves",
    "read_camera": "placefield.features.camera_file",
    "read_truth": "placefield.evaluation.truth",
    "save_map": "placefield.maps.store",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: a process pays for what it uses."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
