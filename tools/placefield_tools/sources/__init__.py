"""Where frames come from: a folder of images, a video file, a camera."""

from placefield_tools.sources.opening import open_source
from placefield_tools.sources.source import Source

__all__ = ["Source", "open_source"]
