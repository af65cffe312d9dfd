"""Where frames come from: a folder of images, a video file, a recording, a camera."""

from placefield_tools.sources.opening import NO_PARTS, Parts, open_source
from placefield_tools.sources.source import Source

__all__ = ["NO_PARTS", "Parts", "Source", "open_source"]
