"""Placefield: visual place recognition with adaptive multiple scales."""

from importlib.metadata import version

__version__ = version("placefield")
