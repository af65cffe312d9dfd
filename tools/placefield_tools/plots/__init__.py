"""Pictures of how good the matches are, as PNG files."""

from placefield_tools.plots.alignment import AlignedTraverse, plot_alignment
from placefield_tools.plots.auc_bars import AucBar, plot_auc_bars
from placefield_tools.plots.autocorrelograms import (
    autocorrelation,
    firing,
    plot_autocorrelograms,
)
from placefield_tools.plots.channel_counts import ChannelCount, plot_channel_counts
from placefield_tools.plots.clusters import plot_clusters
from placefield_tools.plots.distance_matrix import plot_distance_matrix
from placefield_tools.plots.groups import plot_groups
from placefield_tools.plots.match_pairs import MatchPair, plot_match_pairs
from placefield_tools.plots.neighbourhood import (
    Neighbourhood,
    count_invaders,
    plane_positions,
    plot_neighbourhood,
)
from placefield_tools.plots.network import DrawnNetwork, plot_network
from placefield_tools.plots.precision_recall import plot_precision_recall
from placefield_tools.plots.precision_recall_panels import plot_precision_recall_panels
from placefield_tools.plots.reliability_diagram import plot_reliability
from placefield_tools.plots.runs import ChannelSegments
from placefield_tools.plots.segments import plot_segments

__all__ = [
    "AlignedTraverse",
    "AucBar",
    "ChannelCount",
    "ChannelSegments",
    "DrawnNetwork",
    "MatchPair",
    "Neighbourhood",
    "autocorrelation",
    "count_invaders",
    "firing",
    "plane_positions",
    "plot_alignment",
    "plot_auc_bars",
    "plot_autocorrelograms",
    "plot_channel_counts",
    "plot_clusters",
    "plot_distance_matrix",
    "plot_groups",
    "plot_match_pairs",
    "plot_neighbourhood",
    "plot_network",
    "plot_precision_recall",
    "plot_precision_recall_panels",
    "plot_reliability",
    "plot_segments",
]
