"""Placefield: visual place recognition with adaptive multiple scales."""

from importlib.metadata import version

__version__ = version("placefield")

import os

# OpenCV reads this when it is loaded: a small file may claim to be a huge image, and it would make
# room for that before anyone can say no.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "64000000")
