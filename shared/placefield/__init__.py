"""Placefield: visual place recognition with adaptive multiple scales.

A program that has frames at hand needs five lines::

    from placefield import Recognizer, build_map

    recognizer = Recognizer(build_map(reference_images))
    for image in camera:
        print(recognizer.push(image))
"""

import os
from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from placefield.config import Config, MatchingConfig
    from placefield.features.describer import Describer
    from placefield.features.frames import Frame, Pose
    from placefield.fusion.match import Match, SmoothedMatch
    from placefield.library import build_map
    from placefield.maps.map import Map
    from placefield.maps.opening import open_map
    from placefield.maps.store import save_map
    from placefield.recognizer import Recognizer

__version__ = version("placefield")

__all__ = (
    "Config",
    "Describer",
    "Frame",
    "Map",
    "Match",
    "MatchingConfig",
    "Pose",
    "Recognizer",
    "SmoothedMatch",
    "build_map",
    "open_map",
    "save_map",
)

# OpenCV reads this when it is loaded: a small file may claim to be a huge image, and it would make
# room for that before anyone can say no.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "64000000")

_HOMES = {
    "Config": "placefield.config",
    "Describer": "placefield.features.describer",
    "Frame": "placefield.features.frames",
    "Map": "placefield.maps.map",
    "Match": "placefield.fusion.match",
    "MatchingConfig": "placefield.config",
    "Pose": "placefield.features.frames",
    "Recognizer": "placefield.recognizer",
    "SmoothedMatch": "placefield.fusion.match",
    "build_map": "placefield.library",
    "open_map": "placefield.maps.opening",
    "save_map": "placefield.maps.store",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: a process pays for what it uses."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
