"""Which array of a map lies in which file."""

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from placefield.maps.map import Map

# For each folder: its files, with the dtype and the axes of their arrays. An axis of one letter has
# the same length in all files of a folder: K places, P poses, T metres travelled, F frames of a
# traverse, L looks, n local features, N descriptor dimensions, M projected dimensions, D raw
# dimensions, R those of the coarse search, C lists with c rows in all.
Layout = Mapping[str, tuple[str, str]]
MODEL_FILES: Layout = {
    "mean": ("float32", "D"),
    "deviation": ("float32", "D"),
    "components": ("float32", "ND"),
}
NETWORK_FILES: Layout = {"onnx": ("uint8", "o")}
MASK_FILES: Layout = {"used": ("uint8", "hw")}
PLACE_FILES: Layout = {
    "stamps": ("int64", "K"),
    "poses": ("float64", "P3"),
    "travelled": ("float64", "T"),
    "same": ("int32", "K"),
    "thumbnails": ("uint8", "b"),
    "thumbnail_ends": ("int64", "K"),
}
TRAVERSE_FILES: Layout = {"places": ("int32", "F")}
GRAPH_FILES: Layout = {"links": ("int32", "l2")}
LOCAL_FEATURE_FILES: Layout = {
    "points": ("float32", "n2"),
    "descriptors": ("uint8", "nB"),
    "ends": ("int64", "K"),
    "ratios": ("float64", "r"),
}
CHANCE_FILES: Layout = {"by_chance": ("int64", "p")}
METRIC_FILES: Layout = {
    "projection": ("float32", "MN"),
    "places": ("int16", "KM"),
    "squares": ("int32", "K"),
    "steps": ("float32", "6K"),
}
COARSE_FILES: Layout = {
    "axes": ("float32", "RM"),
    "codes": ("int8", "KR"),
    "spread": ("float64", "VV"),
}
LIST_FILES: Layout = {
    "centroids": ("int8", "CR"),
    "ends": ("int64", "C"),
    "places": ("int32", "c"),
    "codes": ("int8", "cR"),
    "squares": ("int32", "c"),
}
LOOK_FILES: Layout = {
    "places": ("int32", "L"),
    "descriptors": ("int16", "LM"),
    "squares": ("int32", "L"),
    "biases": ("int32", "K"),
}
LOOK_TRAVERSE_FILES: Layout = {"traverses": ("int32", "L")}
LOOK_CODE_FILES: Layout = {"codes": ("int8", "LR")}
CHANNEL_FILES: Layout = {
    "labels": ("int32", "K"),
    "segments": ("int32", "s2"),
    "scales": ("int32", "n"),
    "curve": ("float64", "t2"),
}


MASK_FOLDER = "features/mask"


def part_folders(parts: int) -> list[str]:
    """Return the folders of the descriptor models of so many parts of a feature."""
    return ["features"] if parts == 1 else [f"features/{number}" for number in range(parts)]


def look_files(coarse: object | None) -> Layout:
    """Return the files of a metric's looks; ``coarse`` is None without a coarse search."""
    return LOOK_FILES if coarse is None else {**LOOK_FILES, **LOOK_CODE_FILES}


def arrays_of(built: Map) -> dict[str, NDArray[Any]]:
    """Return the arrays of a map by their files."""
    parts: list[tuple[str, Any, Layout]] = []
    models = built.model.parts
    for folder, model in zip(part_folders(len(models)), models, strict=True):
        parts.append((folder, model, MODEL_FILES))
        if model.network is not None:
            parts.append((folder, model.network, NETWORK_FILES))
    parts.append(("places", built.places, PLACE_FILES))
    if built.model.mask is not None:
        parts.append((MASK_FOLDER, built.model.mask, MASK_FILES))
    if len(built.graph.links):
        parts.append(("graph", built.graph, GRAPH_FILES))
    if built.local_features is not None:
        parts.append(("local_features", built.local_features, LOCAL_FEATURE_FILES))
        if len(built.local_features.by_chance):
            parts.append(("local_features", built.local_features, CHANCE_FILES))
        if built.local_features.onnx is not None:
            parts.append(("local_features", built.local_features, NETWORK_FILES))
    for number, traverse in built.alignments.items():
        parts.append((f"traverses/{number}", traverse, TRAVERSE_FILES))
    for number, metric in enumerate(built.metrics):
        parts.append((f"metrics/{number}", metric, METRIC_FILES))
        if metric.coarse is not None:
            parts.append((f"metrics/{number}/coarse", metric.coarse, COARSE_FILES))
            if metric.coarse.lists is not None:
                parts.append((f"metrics/{number}/coarse/lists", metric.coarse.lists, LIST_FILES))
        if metric.looks is not None:
            looks = (f"metrics/{number}/looks", metric.looks)
            parts.append((*looks, look_files(metric.coarse)))
            if metric.looks.traverses is not None:
                parts.append((*looks, LOOK_TRAVERSE_FILES))
    for number, channel in enumerate(built.channels):
        parts.append((f"channels/{number}", channel, CHANNEL_FILES))
    return {
        f"{folder}/{name}.npy": getattr(part, name)
        for folder, part, names in parts
        for name in names
    }
