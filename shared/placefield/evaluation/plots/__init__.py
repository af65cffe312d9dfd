"""Pictures of how good the matches are, as PNG files."""

from placefield.evaluation.plots.distance_matrix import plot_distance_matrix
from placefield.evaluation.plots.match_pairs import MatchPair, plot_match_pairs
from placefield.evaluation.plots.precision_recall import plot_precision_recall
from placefield.evaluation.plots.segments import ChannelSegments, plot_segments

__all__ = [
    "ChannelSegments",
    "MatchPair",
    "plot_distance_matrix",
    "plot_match_pairs",
    "plot_precision_recall",
    "plot_segments",
]
