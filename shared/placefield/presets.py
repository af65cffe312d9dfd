"""Presets: names for many settings at once."""

from collections.abc import Mapping
from typing import Any, Literal

Preset = Literal["paper"]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    "paper": {
        "features": {"plain_pca": True, "standardise": False},
        "scales": {"position_weight": 0.0, "same_start": True},
        "metric": {"kind": "lmnn", "gate": False, "push": "cross-validation", "kept": 1.0},
        # Cuts no window of up to 1001 frames: the smoothed match is the published one.
        "matching": {"rule": "ams", "lag": 1000},
    },
}
"""The settings of each preset, by section; all others keep their defaults.

``paper``: AMS as published. The page on the method lists what the paper leaves open, and what still
differs from it.
"""
