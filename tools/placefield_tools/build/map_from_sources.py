"""Building a map from sources of frames."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from placefield.config import Config
from placefield.errors import MapError, SourceError
from placefield.features.descriptors import DescriptorModel
from placefield.features.extract import Feature, feature_of, network_of
from placefield.features.joined_model import AnyModel, FeaturePart
from placefield.features.kinds import kinds_of
from placefield.maps.build import build_map
from placefield.maps.build_steps import Steps
from placefield.maps.manifest import SUFFIX
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.same_route import align_traverses
from placefield.maps.store import save_map
from placefield.maps.traverse import Traverse
from placefield.verification.extractor import extractor_of
from placefield_tools.build.references import (
    Reference,
    check_distinct,
    describe_reference,
    without_bad,
)
from placefield_tools.build.used_part import ALL_ASKED, WHOLE, AskedPart, UsedPart
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import channel_progress
from placefield_tools.sources import NO_PARTS, Parts, Source, open_source
from placefield_tools.sources.drives import Drive, check_given_once, drives_of
from placefield_tools.sources.frame_content import check_frames, check_images, with_feature_of
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.source_factory import name_of


def build_from(
    references: Sequence[str],
    config: Config,
    *,
    spacing_m: float | None = None,
    parts: Parts = NO_PARTS,
    leave_out_bad: bool = False,
    one_drive: bool | None = None,
    images: AskedPart = ALL_ASKED,
    kept_in: Path | None = None,
) -> Map:
    """Build a map from the sources of its reference traverses, showing progress.

    Args:
        references: sources of frames.
        config: of the map; its feature is that of images, and descriptors need none.
        spacing_m: metres between the frames, by odometry; None: every frame.
        parts: selects topics and frames; its file of poses is for the first traverse, whose frames
            are the places.
        leave_out_bad: build without frames that are missing or cannot be read, in any source; their
            number is logged.
        one_drive: whether the sources are parts of one drive, see ``drives_of``.
        images: what of the images is used.
        kept_in: the folder of finished steps, see ``Steps``; None: they are not kept.

    Raises:
        SourceError: a source or one of its frames cannot be read, a source is a camera, or the
            sources differ in what their frames are.
        ConfigError: see ``AskedPart.found``.
        MapError: no map can be built of the traverses, see ``build_map``.
    """
    first, *others = drives_of(references, parts, one_drive)
    used = images.found(parts, partial(open_reference, first, spacing_m, parts))
    without_poses = replace(parts, poses=None, pose_axes=None)
    drives = [(first, parts), *((other, without_poses) for other in others)]
    described, config, feature = describe_drives(
        drives, config, spacing_m=spacing_m, leave_out_bad=leave_out_bad, used=used
    )
    traverses = [each.traverse() for each in without_bad(described)]
    del described  # of many frames it takes as much memory as the traverses
    traverses = align_traverses(traverses, config.features.kind)
    return used.in_map(built_of(traverses, config, feature.parts, kept_in))


def describe_drives(
    drives: Sequence[tuple[Drive, Parts]],
    config: Config,
    *,
    spacing_m: float | None,
    leave_out_bad: bool,
    used: UsedPart = WHOLE,
) -> tuple[list[Reference], Config, Feature]:
    """Describe the frames of drives by one feature.

    Args:
        drives: at least one, each with its selected topics and frames.
        config: its feature is that of images, and descriptors need none.
        spacing_m: see ``build_from``.
        leave_out_bad: see ``build_from``.
        used: what of the images is used.

    Returns:
        The drives, the configuration with the kind of their feature, and the feature.

    Raises:
        SourceError: see ``build_from``; or a drive is given twice.
        ConfigError: the feature cannot be computed; or local features are asked for, and the frames
            are descriptors, or see ``extractor_of``.
    """
    check_given_once([drive for drive, _ in drives])
    (first, parts), *others = drives
    describe = partial(
        describe_reference,
        leave_out_bad=leave_out_bad,
        extractor=extractor_of(config.build, config.inference),
    )
    first_name = name_of(first)
    with open_reference(first, spacing_m, parts) as source:
        config = with_feature_of(source, first_name, config)
        if config.build.local_features:
            check_images(source, "setting build.local_features")
        feature = used.of(feature_of(config.features.kind, config.inference))
        described = [describe(source, first_name, feature)]
    for drive, own in others:
        name = name_of(drive)
        with open_reference(drive, spacing_m, own) as other:
            check_frames(other, name, source.dimensions, first_name)
            described.append(describe(other, name, feature))
    check_distinct(described)
    return described, config, feature


def built_of(
    traverses: Sequence[Traverse],
    config: Config,
    parts: Sequence[FeaturePart],
    kept_in: Path | None = None,
) -> Map:
    """Build a map of aligned traverses on all cores, showing progress; see ``build_map``.

    Finished steps are kept in a folder, if one is given.
    """
    with channel_progress(config.scales.channels) as progress:
        steps = Steps(map_in_order, progress, kept_in)
        return build_map(traverses, config, parts=parts, steps=steps)


def open_reference(drive: Drive, spacing_m: float | None, parts: Parts) -> Source:
    """Open the sources of a reference; see ``build_from`` for the errors."""
    source = open_source(drive, spacing_m=spacing_m, parts=parts)
    if source.live:
        raise SourceError(
            f"{without_secrets(drive[0])}: no map is built from a live camera; "
            "record a traverse and build from that"
        )
    return source


@contextmanager
def map_of(
    reference: str,
    config: Config,
    *,
    feature_asked: bool,
    spacing_m: float | None = None,
    parts: Parts = NO_PARTS,
    leave_out_bad: bool = False,
    images: AskedPart = ALL_ASKED,
) -> Iterator[Path]:
    """Yield the path of a map: ``reference`` itself, or a temporary map that is built from it.

    Args:
        reference: a map, or a source of frames.
        config: of the map to build.
        feature_asked: whether the user asked for the feature; an existing map must then have it.
        spacing_m: see ``build_from``; not used with an existing map.
        parts: likewise.
        leave_out_bad: likewise.
        images: likewise.

    Raises:
        MapError: the existing map has another feature, or another network.
        PlacefieldError: see ``build_from``.
    """
    path = Path(reference)
    if path.suffix == SUFFIX:
        if feature_asked:
            _check_feature(path, config.features.kind)
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        built = Path(folder) / f"reference{SUFFIX}"
        built_map = build_from(
            [reference],
            config,
            spacing_m=spacing_m,
            parts=parts,
            leave_out_bad=leave_out_bad,
            images=images,
        )
        save_map(built_map, built)
        yield built


def _check_feature(path: Path, kind: str) -> None:
    model = open_map(path).model
    if not _is_of(model, kind):
        asked = f"{kind} as it is now" if kind == model.kind else kind
        raise MapError(
            f"{path}: holds {model.kind} features, not {asked}: "
            "leave --feature out, or build another map"
        )


def _is_of(model: AnyModel, kind: str) -> bool:
    kinds = kinds_of(kind)
    return len(kinds) == len(model.parts) and all(map(_is_of_part, model.parts, kinds))


def _is_of_part(model: DescriptorModel, kind: str) -> bool:
    asked = network_of(kind)
    if asked is None or model.network is None:
        return kind == model.kind
    return asked.digest == model.network.digest  # the path of the network may have changed
