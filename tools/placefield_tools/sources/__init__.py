"""Sources of frames: a folder of images, a video file, a recording, a camera."""

from placefield_tools.sources.source import Source
from placefield_tools.sources.source_factory import NO_PARTS, Parts, open_source

__all__ = ["NO_PARTS", "Parts", "Source", "open_source"]
