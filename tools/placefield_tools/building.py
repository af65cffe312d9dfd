"""Sources of frames to a map."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from placefield.config import Config
from placefield.errors import MapError, SourceError
from placefield.features.extract import KINDS
from placefield.maps.build import build_map, held_back_places
from placefield.maps.map import Map
from placefield.maps.store import SUFFIX, read_manifest, save_map
from placefield.maps.traverse import Traverse, describe_frame, describe_perturbed, traverse_of
from placefield_tools.parallel import map_in_order
from placefield_tools.progress import progress_bar, tracked
from placefield_tools.sources import Source, open_source


def build_from(references: Sequence[str], config: Config) -> Map:
    """Build a map from the sources of its reference traverses, showing progress.

    Raises:
        SourceError: a source or one of its frames cannot be read, or is a camera.
        MapError: the traverses do not make a map, see ``build_map``.
    """
    traverses = [_describe(reference, config) for reference in references]
    perturbed = _describe_perturbed(references[0], len(traverses[0].raw), config)
    with progress_bar() as bar:
        task = bar.add_task("learning channels", total=None)

        def progress(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        return build_map(traverses, perturbed, config, progress)


def _describe(reference: str, config: Config) -> Traverse:
    with _open_reference(reference) as source:
        frames = tracked(source, f"describing {Path(reference).name}", source.count)
        describe = partial(describe_frame, kind=config.features.kind)
        return traverse_of(reference, map_in_order(describe, frames))


def _describe_perturbed(reference: str, count: int, config: Config) -> np.ndarray:
    kind = config.features.kind
    if config.metric.kind == "identity":
        return np.empty((0, 0, KINDS[kind].raw_dimensions), np.float32)
    held_back = held_back_places(count, config.seed)
    if not held_back.any():
        raise MapError(
            f"{reference}: {count} frames are too few to learn a metric from; give more frames"
        )
    with _open_reference(reference) as source:
        chosen = (frame for frame in source if held_back[frame.index])
        frames = tracked(chosen, "perturbing held-back frames", int(held_back.sum()))
        describe = partial(describe_perturbed, kind=kind, seed=config.seed)
        return np.stack(list(map_in_order(describe, frames)))


def _open_reference(reference: str) -> Source:
    source = open_source(reference)
    if source.live:
        raise SourceError(
            f"{reference}: a camera gives no second look; record a traverse and build from that"
        )
    return source


@contextmanager
def map_of(reference: str, config: Config, *, feature_asked: bool) -> Iterator[Path]:
    """Give the path of a map: of ``reference`` itself, or one built from it for the time being.

    Args:
        reference: a map, or a source of frames.
        config: of the map to build.
        feature_asked: whether the feature was asked for, which a map there already must then hold.

    Raises:
        MapError: the map holds another feature.
        PlacefieldError: see ``build_from``.
    """
    path = Path(reference)
    if path.suffix == SUFFIX:
        kind = read_manifest(path).features.kind
        if feature_asked and kind != config.features.kind:
            raise MapError(
                f"{path}: holds {kind} features, not {config.features.kind}: "
                "leave --feature out, or build another map"
            )
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        built = Path(folder) / f"reference{SUFFIX}"
        save_map(build_from([reference], config), built)
        yield built
