"""Matching as ``evaluate`` does: by every rule, at once and with several lags."""

import time
from dataclasses import replace
from functools import partial
from typing import get_args

from placefield.config import MatchingConfig, Rule
from placefield.maps.map_metrics import identity_metric
from placefield.matching.matcher import WHOLE_DRIVE
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.random_walks import observed_again, random_walk
from placefield_tools.bench.synthetic import made_map
from placefield_tools.bench.timing import Timings
from placefield_tools.evaluate.drive_matching import Metres, match_drive
from placefield_tools.evaluate.evaluation import LAGS

_PLACES, _DIMENSIONS, _FRAMES = 1261, 300, 300


def evaluation_figures() -> list[Figure]:
    """Measure on one core, with channels that share a metric, as those of descriptors do.

    Once a stream is smoothed with all lags; once more there is a stream for each lag.
    """
    walk = random_walk(_PLACES, _DIMENSIONS, seed=0)
    placemap, metric = made_map(walk), identity_metric(walk)
    channels = [replace(channel, metric=metric) for channel in placemap.channels]
    query = [*observed_again(walk[200 : 200 + _FRAMES], 0.5, seed=1)]
    metres = Metres(placemap, [None] * _FRAMES)
    lags = (*LAGS, WHOLE_DRIVE)

    def match(groups: list[tuple[int, ...]]) -> None:
        for rule in get_args(Rule):
            for group in groups:
                match_drive(channels, query, metres, MatchingConfig(rule=rule), group)

    ways = [partial(match, [lags]), partial(match, [(lag,) for lag in lags])]
    times = Timings.of(ways, compared=[(1, 0)], clock=time.process_time)
    return [
        Figure(
            "evaluate_frames_per_s",
            _FRAMES / times.median(0),
            "every rule, at once and with three lags, one core",
            at_least=5000,
        ),
        Figure(
            "lags_speedup", times.ratio(1, 0), "a stream for each lag, over one stream for all lags"
        ),
    ]
