"""Fuse what the channels of a map say of a frame by a rule of your own.

    python examples/own_rule.py route.pfmap demo/dusk

Placefield's rule ``evidence`` takes the mean over the channels, of how far each place is from the
last frames. This one takes the median, which a single channel that is far off does not move. The
stages are those that ``Recognizer`` and the services are made of.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from placefield import Map, MatchingConfig, open_map
from placefield.features.descriptor_stage import DescriptorStage
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield.matching.channel_stage import ChannelStage


def fuse(candidates: Sequence[Candidate]) -> int:
    """Return the place that is nearest in the median of the channels that answered."""
    distances = [each.evidence for each in candidates if each.place != UNANSWERED]  # (K,) each
    return int(np.median(distances, axis=0).argmin()) if distances else UNANSWERED


def places(placemap: Map, files: Sequence[Path]) -> Iterator[int]:
    """Yield the place of each frame."""
    images = DescriptorStage(placemap.model).new_stream()
    channels = dict(enumerate(placemap.channels))
    stage = ChannelStage(channels, MatchingConfig(rule="evidence"))
    stream = stage.new_stream()
    for file in files:
        (compared,) = stage.compare([images.update(file.read_bytes())])
        yield fuse(stream.update(compared))


def main(route: str, query: str) -> None:
    """Print the place of each frame of a folder."""
    files = sorted(Path(query).glob("*.jpg"))
    for file, place in zip(files, places(open_map(Path(route)), files), strict=True):
        print(file.name, place)


if __name__ == "__main__":
    main(*sys.argv[1:])
