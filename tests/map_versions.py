"""Versions of one map that answer differently."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from placefield.features.descriptor_stage import DescriptorStage
from placefield.maps.map import Map
from placefield_tools.bench.synthetic import made_channel


def version_of(placemap: Map, reference: Path, number: int) -> Map:
    """Return a version of a map of a reference traverse, with metrics of its own."""
    stream = DescriptorStage(placemap.model).new_stream()
    described = [stream.update(file.read_bytes()) for file in sorted(reference.iterdir())]
    walk = np.stack([each for each in described if each is not None])
    count = len(placemap.channels)
    channels = tuple(made_channel(walk, number * count + channel) for channel in range(count))
    return replace(placemap, channels=channels, digest=f"{number:016x}")
