"""Saving a map to disk: ``NAME.pfmap/`` with a manifest and ``.npy`` files.

A map is written to a temporary folder and renamed, so that a killed build leaves no partial map.
The folder that it leaves is removed when the map is written again.
"""

import errno
import glob
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np

from placefield.errors import MapError
from placefield.features.joined_model import AnyModel
from placefield.features.network import Network, NetworkInput
from placefield.files import exchange, sync, write_whole
from placefield.locking import has_locks, take_lock
from placefield.maps.array_layout import arrays_of
from placefield.maps.checksums import checksum_of
from placefield.maps.manifest import (
    LONGEST_MANIFEST,
    MANIFEST,
    SEAL,
    ChannelRecord,
    Manifest,
    MetricRecord,
    PartRecord,
    RouteRecord,
    check_map_path,
    seal_of,
)
from placefield.maps.map import Map, fingerprint

# The file in a temporary folder that its writer locks: an unlocked one is of a dead process. It has
# the second name once it is locked.
_UNLOCKED, _LOCKED = "unlocked", "locked"


def save_map(built: Map, path: Path | str) -> None:
    """Save a map; an existing map at the path is replaced at the end.

    Raises:
        MapError: see ``check_map_path``, or the map cannot be written.
    """
    path = Path(path)
    check_map_path(path)
    try:
        with _written_beside(path) as folder:
            _write(built, folder)
    except OSError as error:
        # numpy reports an array that was written in part by an error without errno
        full = error.errno in (None, errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        what = "the disk is full; free some space" if full else (error.strerror or str(error))
        raise MapError(f"{path}: cannot write the map: {what}") from None


@contextmanager
def _written_beside(path: Path) -> Iterator[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_abandoned(path)
    with (
        tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as temporary,
        (Path(temporary) / _UNLOCKED).open("wb") as mark,
    ):
        if has_locks():
            take_lock(mark)
            Path(mark.name).rename(Path(temporary) / _LOCKED)
        folder = Path(temporary) / "new"
        folder.mkdir()
        yield folder
        _put_in_place(folder, path)


def _remove_abandoned(path: Path) -> None:
    """Remove what killed processes left behind when they wrote the map at a path."""
    for mark in path.parent.glob(f".{glob.escape(path.name)}.*/{_LOCKED}"):
        with suppress(OSError), mark.open("rb") as opened:  # gone by now, or of another user
            if take_lock(opened):
                shutil.rmtree(mark.parent, ignore_errors=True)


def _put_in_place(folder: Path, path: Path) -> None:
    """Rename a folder to a path; where the path is taken, its folder goes to the other place."""
    if not path.exists():
        folder.rename(path)
        return
    try:
        exchange(folder, path)
    except OSError:
        old = folder.with_name("old")
        path.rename(old)
        try:
            folder.rename(path)
        except OSError:
            old.rename(path)
            raise


def _write(built: Map, folder: Path) -> None:
    files = {}
    for name, array in arrays_of(built).items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, array, allow_pickle=False)
        sync(file)
        files[name] = checksum_of(file)
    parts = _parts_of(built.model)
    manifest = Manifest(
        placefield=version("placefield"),
        preset=built.preset,
        seed=built.seed,
        features=built.features,
        scales=built.scales,
        metric=built.metric,
        model=fingerprint(built.model),
        variance_kept=built.model.variance_kept,
        network=None if parts else _input_of(built.model.parts[0].network),
        least_side=None if parts else built.model.parts[0].least_side,
        parts=parts,
        view=built.model.view,
        places=built.places.count,
        smallest_scale=built.channels[0].smallest,
        pose_frame=built.pose_frame,
        traverses=built.traverses,
        history=built.history,
        routes=_routes(built),
        links=len(built.graph.links),
        local_features=0 if built.local_features is None else len(built.local_features.points),
        metrics=tuple(
            MetricRecord(
                learned=metric.learned,
                unit=metric.unit,
                coarse_unit=metric.coarse.unit if metric.coarse else None,
                looks=len(metric.looks.places) if metric.looks else 0,
            )
            for metric in built.metrics
        ),
        channels=tuple(
            ChannelRecord(
                fuzzifier=c.fuzzifier,
                clusters=c.clusters,
                metric=built.metrics.index(c.metric),
                refusal=c.refusal,
            )
            for c in built.channels
        ),
        files=files,
    )
    written = manifest.model_dump_json(indent=1).encode()
    if len(written) > LONGEST_MANIFEST:
        raise MapError(
            f"{MANIFEST}: more than {LONGEST_MANIFEST} bytes, because of its many channels; "
            "build fewer channels"
        )
    write_whole(folder / MANIFEST, written)
    write_whole(folder / SEAL, seal_of(written))


def _parts_of(model: AnyModel) -> tuple[PartRecord, ...]:
    """Return the records of the parts of a feature of several."""
    if len(model.parts) == 1:
        return ()
    return tuple(
        PartRecord(
            variance_kept=part.variance_kept,
            network=_input_of(part.network),
            least_side=part.least_side,
        )
        for part in model.parts
    )


def _input_of(network: Network | None) -> NetworkInput | None:
    return None if network is None else network.input


def _routes(built: Map) -> tuple[RouteRecord, ...]:
    """Return the records of the routes; of a map of one route there are none."""
    graph = built.graph
    if len(graph.names) == 1:
        return ()
    counts = np.diff(graph.first, append=built.places.count).tolist()
    records = zip(graph.names, counts, strict=True)
    return tuple(RouteRecord(name=name, places=places) for name, places in records)
