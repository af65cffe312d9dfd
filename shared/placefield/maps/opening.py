"""Opening a map from disk: its files are checked, and large arrays are memory-mapped."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.features.descriptors import DescriptorModel
from placefield.features.joined_model import AnyModel, JoinedModel
from placefield.features.kinds import kinds_of
from placefield.features.network import Network, NetworkInput
from placefield.maps.array_layout import (
    CHANCE_FILES,
    GRAPH_FILES,
    LOCAL_FEATURE_FILES,
    MASK_FILES,
    MASK_FOLDER,
    MODEL_FILES,
    NETWORK_FILES,
    PLACE_FILES,
    TRAVERSE_FILES,
    part_folders,
)
from placefield.maps.manifest import REBUILD, PartRecord, read_identified
from placefield.maps.map import STEPS, Map, MapAlignment, Places, fingerprint
from placefield.maps.map_channels import MapChannels
from placefield.maps.map_files import MapFiles
from placefield.maps.route_graph import NO_LINKS, RouteGraph, problem_of
from placefield.verification.local_features import SIFT_LENGTH
from placefield.verification.place_features import NO_PAIRS, PlaceFeatures, problem_with

if TYPE_CHECKING:  # a router has no OpenCV
    from placefield.features.mask import Mask


def open_map(
    path: Path | str, channels: Collection[int] | None = None, *, lineage: str | None = None
) -> Map:
    """Open a map; large arrays are memory-mapped, so that all processes of a host share them.

    Args:
        path: of the map.
        channels: the channels that are read and checked now; None: all, and the identity. The
            others are read and checked at the first access, which may raise the same errors.
        lineage: the lineage that the map must have, see ``lineage_of``; None accepts any map.

    Raises:
        MapError: there is no map, it is of another format or lineage, or the checksum, dtype or
            shape of a file is wrong.
    """
    path = Path(path)
    manifest, found = read_identified(path, lineage)
    files = MapFiles(path, manifest)
    count = manifest.places
    sizes = {"K": count, "P": count if manifest.pose_frame else 0, "2": 2, "3": 3, "6": STEPS}
    model = _open_model(files)
    sizes["N"] = model.dimensions
    if fingerprint(model) != manifest.model:
        raise MapError(f"{path}: its descriptor model is not the manifest's; {REBUILD}")
    places = Places(*files.load("places", PLACE_FILES, sizes))
    _check_travelled(path, places)
    _check_same(path, places.same)
    all_channels = MapChannels(files, sizes)
    all_channels.open(channels or ())
    return Map(
        preset=manifest.preset,
        seed=manifest.seed,
        features=manifest.features,
        scales=manifest.scales,
        metric=manifest.metric,
        traverses=manifest.traverses,
        pose_frame=manifest.pose_frame,
        model=model,
        places=places,
        channels=tuple(all_channels) if channels is None else all_channels,
        graph=_open_graph(files),
        alignments=dict(_open_alignments(files)),
        local_features=_open_local_features(files),
        history=manifest.history,
        identity=all_channels.open_identity() if channels is None else None,
        digest=found,
        check_unchanged=files.check_unchanged,
    )


def _check_travelled(path: Path, places: Places) -> None:
    travelled = places.travelled
    is_complete = len(travelled) == places.count and np.isfinite(travelled).all()
    if len(travelled) and not (is_complete and (np.diff(travelled) >= 0).all()):
        file = path / "places" / "travelled.npy"
        raise MapError(f"{file}: not one ascending count of metres per place; {REBUILD}")


def _check_same(path: Path, same: NDArray[np.int32]) -> None:
    is_earlier = ((same >= 0) & (same <= np.arange(len(same)))).all()
    if not (is_earlier and (same[same] == same).all()):
        file = path / "places" / "same.npy"
        raise MapError(f"{file}: does not name the earliest same place of each; {REBUILD}")


def _open_alignments(files: MapFiles) -> Iterator[tuple[int, MapAlignment]]:
    for number, record in enumerate(files.manifest.traverses):
        if record.aligned is None:
            continue
        folder = f"traverses/{number}"
        (places,) = files.load(folder, TRAVERSE_FILES, {"F": record.frames})
        is_place = (places >= -1) & (places < files.manifest.places)
        if not (is_place.all() and np.count_nonzero(places >= 0) == record.aligned):
            file = files.path / folder / "places.npy"
            raise MapError(
                f"{file}: does not fit the map's places or 'aligned' in its manifest; {REBUILD}"
            )
        yield number, MapAlignment(places)


def _open_graph(files: MapFiles) -> RouteGraph:
    manifest = files.manifest
    links = NO_LINKS
    if manifest.links:
        (links,) = files.load("graph", GRAPH_FILES, {"l": manifest.links, "2": 2})
    names = tuple(record.name for record in manifest.routes)
    counts = [record.places for record in manifest.routes]
    if not names:
        names, counts = tuple(each.name for each in manifest.traverses[:1]), [manifest.places]
    first = np.cumsum([0, *counts[:-1]], dtype=np.int32)
    first.setflags(write=False)
    graph = RouteGraph(names, first, links)
    problem = problem_of(graph, manifest.places)
    if sum(counts) != manifest.places:
        problem = "the routes have more or fewer places than the map"
    if problem is not None:
        raise MapError(f"{files.path}: routes and links: {problem}; {REBUILD}")
    return graph


def _open_local_features(files: MapFiles) -> PlaceFeatures | None:
    manifest = files.manifest
    if not manifest.local_features:
        return None
    folder = "local_features"
    has_chance, has_network = (
        f"{folder}/{name}.npy" in manifest.files for name in ("by_chance", "onnx")
    )
    sizes = {"K": manifest.places, "n": manifest.local_features, "2": 2}
    if not has_network:
        sizes["B"] = SIFT_LENGTH
    found = PlaceFeatures(
        *files.load(folder, LOCAL_FEATURE_FILES, sizes),
        *(files.load(folder, CHANCE_FILES, {}) if has_chance else [NO_PAIRS]),
        *(files.load(folder, NETWORK_FILES, {}) if has_network else []),
    )
    if problem := problem_with(found):
        raise MapError(f"{files.path / folder}: {problem}; {REBUILD}")
    return found


def _open_model(files: MapFiles) -> AnyModel:
    manifest, features = files.manifest, files.manifest.features
    kinds = kinds_of(features.kind)
    records = manifest.parts or (
        PartRecord(
            variance_kept=manifest.variance_kept,
            network=manifest.network,
            least_side=manifest.least_side,
        ),
    )
    if len(kinds) != len(records):
        raise MapError(f"{files.path}: its feature has other parts than its manifest; {REBUILD}")
    folders = part_folders(len(kinds))
    parts = []
    for kind, folder, record in zip(kinds, folders, records, strict=True):
        mean, deviation, components = files.load(folder, MODEL_FILES, {})
        parts.append(
            DescriptorModel(
                kind,
                features.standardise,
                mean,
                deviation,
                components,
                record.variance_kept,
                features.plain_pca,
                _open_network(files, folder, record.network),
                least_side=record.least_side,
            )
        )
    model = parts[0] if len(parts) == 1 else JoinedModel(tuple(parts))
    return replace(model, mask=_open_mask(files), view=manifest.view)


def _open_network(files: MapFiles, folder: str, given: NetworkInput | None) -> Network | None:
    return None if given is None else Network(given, *files.load(folder, NETWORK_FILES, {}))


def _open_mask(files: MapFiles) -> Mask | None:
    """Open the mask of a map that has one."""
    if not any(name.startswith(f"{MASK_FOLDER}/") for name in files.manifest.files):
        return None
    from placefield.features.images import MAX_PIXELS
    from placefield.features.mask import Mask

    (used,) = files.load(MASK_FOLDER, MASK_FILES, {})
    if not 0 < used.size <= MAX_PIXELS or used.max() != 1:
        file = files.path / MASK_FOLDER / "used.npy"
        raise MapError(f"{file}: is no mask of 0 and 1; {REBUILD}")
    return Mask(used)
