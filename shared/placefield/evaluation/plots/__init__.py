"""Pictures of how good the matches are, as PNG files."""

from placefield.evaluation.plots.auc_bars import AucBar, plot_auc_bars
from placefield.evaluation.plots.autocorrelograms import (
    autocorrelation,
    firing,
    plot_autocorrelograms,
)
from placefield.evaluation.plots.channel_counts import ChannelCount, plot_channel_counts
from placefield.evaluation.plots.clusters import plot_clusters
from placefield.evaluation.plots.distance_matrix import plot_distance_matrix
from placefield.evaluation.plots.groups import plot_groups
from placefield.evaluation.plots.match_pairs import MatchPair, plot_match_pairs
from placefield.evaluation.plots.neighbourhood import (
    Neighbourhood,
    count_invaders,
    plane_positions,
    plot_neighbourhood,
)
from placefield.evaluation.plots.precision_recall import plot_precision_recall
from placefield.evaluation.plots.precision_recall_panels import plot_precision_recall_panels
from placefield.evaluation.plots.reliability import plot_reliability
from placefield.evaluation.plots.runs import ChannelSegments
from placefield.evaluation.plots.segments import plot_segments

__all__ = [
    "AucBar",
    "ChannelCount",
    "ChannelSegments",
    "MatchPair",
    "Neighbourhood",
    "autocorrelation",
    "count_invaders",
    "firing",
    "plane_positions",
    "plot_auc_bars",
    "plot_autocorrelograms",
    "plot_channel_counts",
    "plot_clusters",
    "plot_distance_matrix",
    "plot_groups",
    "plot_match_pairs",
    "plot_neighbourhood",
    "plot_precision_recall",
    "plot_precision_recall_panels",
    "plot_reliability",
    "plot_segments",
]
