"""The main facts about a map, as text."""

import numpy as np

from placefield.features.joined_model import AnyModel
from placefield.maps.geography import Origin
from placefield.maps.manifest import TraverseRecord
from placefield.maps.map import Map, Places
from placefield_tools.common.natural_sort import counted


def map_facts(opened: Map) -> dict[str, str]:
    """Return facts about a map by their names."""
    model = opened.model
    made = "standardised" if model.standardise else "not standardised"
    if model.plain:
        made = "plain PCA"
    return {
        "preset": opened.preset or "none",
        "places": f"{opened.places.count}, {_poses(opened)}",
        "travelled": _travelled(opened.places),
        "revisited": _revisited(opened.places),
        "traverses": "; ".join(traverse_line(record) for record in opened.traverses),
        "descriptor": f"{model.kind}, {made}, {model.dimensions} dimensions that keep "
        f"{model.variance_kept:.1%} of the variance",
        "decoding": _decoding(model),
        "view": _view(model),
        "mask": _mask(model),
        "smallest scale": f"{opened.channels[0].smallest} frames",
        "metric": _metric(opened),
        "search": "coarse, then re-ranked" if opened.metrics[0].coarse else "exact",
        "looks": _looks(opened),
        "local features": _local_features(opened),
        "seed": str(opened.seed),
        "history": _history(opened),
        "digest": opened.digest,
    }


def _decoding(model: AnyModel) -> str:
    if model.least_side is None:
        return "whole frames"
    return f"JPEG to a part of its size, of at least {model.least_side} pixels a side"


def _view(model: AnyModel) -> str:
    if model.view is None:
        return "frames as they are"
    return "rectified to {:.0f}° × {:.0f}°".format(*model.view.degrees)


def _mask(model: AnyModel) -> str:
    return f"hides {model.mask.hidden:.0%} of each image" if model.mask else "none"


def traverse_line(record: TraverseRecord) -> str:
    """Describe a traverse: its name, its frames, and how they were aligned to the first."""
    frames = f"{record.name}: {counted(record.frames, 'frame')}"
    if record.aligned is None:
        return frames
    left_out = record.frames - record.aligned
    return f"{frames}, {record.aligned} aligned by {record.by}, {left_out} left out"


def _metric(opened: Map) -> str:
    """Describe how the metrics were learned, how many were kept, and why the others were not.

    A map of an earlier version does not hold the reasons.
    """
    config = opened.metric
    if config.kind == "identity":
        return "identity"
    asked = f"{config.kind}, push {config.push:.3g}" if config.kind == "lmnn" else config.kind
    channels = opened.channels
    kept = sum(channel.metric.learned for channel in channels)
    summary = f"{asked}: kept in {kept} of {counted(len(channels), 'channel')}"
    reasons = dict.fromkeys(channel.refusal for channel in channels if channel.refusal)
    return "; ".join([summary, *(f"else the identity: {reason}" for reason in reasons)])


def _looks(opened: Map) -> str:
    """Describe the looks of the places, their size, and the comparisons that they add."""
    looks = opened.metrics[0].looks
    if looks is None:
        return "one of each place"
    count, places = len(looks.places), opened.places.count
    size = sum(metric.looks.nbytes for metric in opened.metrics if metric.looks is not None)
    of = ""
    if looks.traverses is not None:
        counts = np.bincount(looks.traverses, minlength=len(opened.traverses))
        with_counts = zip(opened.traverses, counts, strict=True)
        of = f" ({', '.join(f'{n} by {record.name}' for record, n in with_counts if n)})"
    return (
        f"{count} more of {len(np.unique(looks.places))} places{of}, {size / 2**20:.1f} MB; "
        f"a frame is compared with {places + count} descriptors instead of {places} in each metric"
    )


def _local_features(opened: Map) -> str:
    """Describe the local features of the places, which verify matches."""
    found = opened.local_features
    if found is None:
        return "none"
    size = found.points.nbytes + found.descriptors.nbytes
    by = "SIFT" if found.onnx is None else "a network"
    return f"{found.most} of a place at most by {by}, {size / 2**20:.1f} MB"


def _history(opened: Map) -> str:
    """Describe what was added and dropped since the map was built, and of which versions."""
    changes = [f"{one.drive} {one.change} (before: {one.before})" for one in opened.history]
    return "; ".join(changes) or "as built"


def _travelled(places: Places) -> str:
    """Describe how far the places are apart."""
    if not len(places.travelled):
        return "unknown"
    metres = float(places.travelled[-1] - places.travelled[0])
    mean = metres / max(places.count - 1, 1)
    return f"{metres:.1f} m, {mean:.2f} m from place to place on average"


def _revisited(places: Places) -> str:
    """Describe how many places are the same as earlier places."""
    count = int(np.count_nonzero(places.same != np.arange(places.count)))
    return f"{count} places are the same as earlier ones" if count else "no place"


def _poses(opened: Map) -> str:
    """Describe the poses of the places."""
    if opened.pose_frame is None:
        return "without poses"
    unknown = int(np.isnan(opened.places.poses[:, 0]).sum())
    but = f", {counted(unknown, 'place')} without" if unknown else ""
    origin = Origin.of_frame(opened.pose_frame)
    if origin is None:
        return f"with poses in metres, not georeferenced{but}"
    return f"with poses georeferenced at {origin.latitude:.6f} {origin.longitude:.6f}{but}"
