"""Many settings in one word."""

from collections.abc import Mapping
from typing import Any, Literal

Preset = Literal["paper"]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    "paper": {
        "features": {"plain_pca": True, "standardise": False},
        "scales": {"position_weight": 0.0, "same_start": True},
        "metric": {"kind": "lmnn", "gate": False, "push": "cross-validation"},
        # Cuts no window of up to 1001 frames: the smoothed match is the published one.
        "matching": {"rule": "ams", "lag": 1000},
    },
}
"""What each preset sets, by section; everything else stays as it is by default.

``paper``: AMS as it is published. See the method's page for what the paper leaves open, and for
what even so is done otherwise.
"""
