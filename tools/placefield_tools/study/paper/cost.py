"""What matching a frame costs: as the paper counts it (section 4.3.5), and measured."""

import time
import tracemalloc
from collections.abc import Iterable, Sequence

from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.channel_stage import ChannelStage
from placefield_tools.study.methods import match_smoothed
from placefield_tools.study.paper.paper_results import Cost
from placefield_tools.study.trial import Trial

COMPARISONS_PER_SECOND = 1e9
"""Of single bytes, that the paper takes a core to do."""


def comparisons(cost: Cost, *, one_scale: bool = False) -> int:
    """Count a frame's comparisons as the paper does: K N L times the longest scale.

    With one scale, as for the methods that have no more, the longest counts as 1.
    """
    return cost.places * cost.dimensions * cost.channels * (1 if one_scale else cost.longest)


def multiplications(cost: Cost) -> int:
    """Count what our matching multiplies: a frame under each metric, with every place.

    N (N + K) L, whatever the scales, as sums of windows go on from frame to frame.
    """
    return cost.dimensions * (cost.dimensions + cost.places) * cost.channels


def measure_cost(trial: Trial) -> Cost:
    """Match the drive once more, and measure.

    Args:
        trial: by the preset ``paper``.
    """
    channels = trial.placemap.channels
    begun = time.perf_counter()
    match_smoothed(channels, trial, "ams", trial.config.matching.lag)
    seconds = (time.perf_counter() - begun) / len(trial.descriptors)
    return Cost(
        places=trial.places,
        dimensions=trial.placemap.model.dimensions,
        channels=len(channels),
        longest=max(int(channel.scales.max()) for channel in channels),
        seconds=seconds,
        kept_bytes=_metric_bytes({each.metric for each in channels})
        + _stream_bytes(trial, channels),
    )


def _metric_bytes(metrics: Iterable[MapMetric]) -> int:
    return sum(
        each.places.nbytes + each.squares.nbytes + each.projection.nbytes for each in metrics
    )


def _stream_bytes(trial: Trial, channels: Sequence[MapChannel]) -> int:
    """Measure what a stream that has begun holds."""
    stage = ChannelStage(dict(enumerate(channels)), trial.matching("ams"))
    tracemalloc.start()
    stream = stage.new_stream()
    stream.update(None)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return held
