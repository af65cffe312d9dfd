"""The paper's figures, of a study's results, as images in data URLs."""

from placefield_tools.inspect.map_summary import segments_of
from placefield_tools.plots import (
    AucBar,
    ChannelCount,
    plot_auc_bars,
    plot_autocorrelograms,
    plot_channel_counts,
    plot_clusters,
    plot_precision_recall,
    plot_segments,
)
from placefield_tools.study.figures import data_url, pictures_of
from placefield_tools.study.paper.paper_results import FeatureResult, PaperStudy


def compared_curves(study: PaperStudy) -> str:
    """Draw precision over recall of AMS, MS and the others (figures 12(a) and 13(a))."""
    curves = {
        f"{line.method}, {result.feature}": line.judged.curve
        for result in study.features
        for line in result.lines
        if line.scales == "many"
    }
    curves |= {o.name: o.judged.curve for o in study.others if o.judged is not None}
    return data_url(lambda path: plot_precision_recall(path, curves, "Precision over recall"))


def compared_bars(study: PaperStudy) -> str:
    """Draw AUC and recall of the same (figures 12(b) and 13(b))."""
    bars = [
        AucBar(
            name=f"{line.method}, {result.feature}",
            auc=line.judged.curve.auc,
            recall=line.judged.curve.recall_at_100_precision,
            ours=line.method == "AMS",
        )
        for result in study.features
        for line in result.lines
        if line.scales == "many"
    ]
    for other in study.others:
        curve = None if other.judged is None else other.judged.curve
        auc = None if curve is None else curve.auc
        recall = None if curve is None else curve.recall_at_100_precision
        bars.append(AucBar(name=other.name, auc=auc, recall=recall, ours=False))
    return data_url(lambda path: plot_auc_bars(path, bars))


def scale_curves(result: FeatureResult) -> str:
    """Draw precision over recall of MS and AMS, on one scale and on many (figures 16 and 17)."""
    curves = {
        f"{line.method}, {line.scales} scale{'s' * (line.scales == 'many')}": line.judged.curve
        for line in result.lines
    }
    return data_url(lambda path: plot_precision_recall(path, curves, result.feature))


def channel_counts(study: PaperStudy) -> str | None:
    """Draw AUC and recall over the number of combined channels (figures 18 to 20)."""
    counts = [
        ChannelCount(result.feature, count.channels, count.auc, count.recall)
        for result in study.features
        for count in result.counts
    ]
    return data_url(lambda path: plot_channel_counts(path, counts)) if counts else None


def clusters(result: FeatureResult) -> str | None:
    """Draw the first channel's clusters with some of their frames (figures 5 and 11).

    Descriptors have no frames to draw.
    """
    if not result.placemap.places.has_thumbnails:
        return None
    channel, picture_of = segments_of(result.placemap)[0], pictures_of(result.placemap)
    return data_url(lambda path: plot_clusters(path, channel, picture_of), photographs=True)


def segments(result: FeatureResult) -> str:
    """Draw the segments of all channels (figure 7)."""
    channels, places = segments_of(result.placemap), result.placemap.places.count
    return data_url(lambda path: plot_segments(path, channels, places))


def autocorrelograms(result: FeatureResult) -> str:
    """Draw the channels' autocorrelograms (figure 1)."""
    channels = segments_of(result.placemap)
    return data_url(lambda path: plot_autocorrelograms(path, channels))
