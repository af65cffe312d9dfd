"""Runs a study of a reference and a query."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from placefield.baselines.fabmap import Vocabulary
from placefield.config import Config
from placefield.errors import MapError, SourceError, TruthError
from placefield.evaluation.protocols import TAKES_EVERY, THINS_REFERENCE, default_every
from placefield.evaluation.truth import Truth
from placefield.features.calibration import View
from placefield.features.extract import feature_of
from placefield.features.joined_model import FeaturePart
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse
from placefield_tools.build.used_part import AskedPart, UsedPart
from placefield_tools.common.progress import CONSOLE
from placefield_tools.evaluate.drive_matching import Metres, descriptors_of
from placefield_tools.evaluate.evaluation import drive_in
from placefield_tools.evaluate.query import Query
from placefield_tools.evaluate.truth_source import TruthOptions, TruthSides, find_truth
from placefield_tools.sources import Source, open_source
from placefield_tools.sources.frame_content import check_frames, with_feature_of
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.thinned import Thinned
from placefield_tools.study.ablation import ablate
from placefield_tools.study.describing import (
    describe_query_frames,
    describe_reference,
    learn_vocabulary,
)
from placefield_tools.study.methods import methods_of, run_methods
from placefield_tools.study.neighbours import learned_by
from placefield_tools.study.results import Study
from placefield_tools.study.trial import (
    Trial,
    build_reference,
    fixed_map,
    plain_channel,
)

SHORTEST_MIN_SCALE = 2

TruthOf = Callable[[int, int, int], Truth]
"""Gives the truth for so many frames of the query and of the reference, where every n-th of the
latter is a place."""


def run_study(
    reference: str,
    query: Query,
    truth_of: TruthOf,
    config: Config,
    *,
    tolerance: int | None,
    asked: TruthOptions | None = None,
) -> Study:
    """Run every method on the same frames, showing progress.

    Args:
        reference: source of the reference's frames.
        query: the query, and how it is driven.
        truth_of: gives the truth of the query in its own order.
        config: of our map, its matching and all that is random.
        tolerance: shown in the report; None if a ground truth or metres were given.
        asked: the other options of the ground truth, see ``find_truth``.

    Raises:
        PlacefieldError: the sources or the truth cannot be read, or do not make our map, or there
            is no ground truth. If another method fails, this is reported, and the others continue.
    """
    trial = prepare(reference, query, truth_of, config, asked=asked)
    return Study(
        reference=reference,
        query=query.where,
        protocol=query.protocol,
        every=trial.every,
        lowered_min_scale=trial.lowered_min_scale,
        seed=config.seed,
        tolerance=tolerance,
        placemap=trial.placemap,
        fixed=fixed_map(trial),
        learned=learned_by(trial),
        methods=run_methods(trial, methods_of(trial)),
        ablation=ablate(trial),
        ground=trial.ground,
    )


def prepare(
    reference: str,
    query: Query,
    truth_of: TruthOf,
    config: Config,
    *,
    words: bool = True,
    asked: TruthOptions | None = None,
) -> Trial:
    """Describe all frames, build our map, and drive the query; see ``run_study``.

    Without ``words``, FAB-MAP cannot run.
    """
    with open_source(reference, spacing_m=query.spacing_m, parts=query.parts) as whole:
        config = with_feature_of(whole, reference, config)
        used = UsedPart(AskedPart(query_cameras=query.other_cameras).view(query.parts))
        feature = used.of(feature_of(config.features.kind, config.inference))
        if whole.live:
            camera = without_secrets(reference)
            raise SourceError(
                f"{camera}: a study needs to read the frames twice; record a traverse"
            )
        query, source = _agreed(query, whole)
        has_words = words and whole.dimensions is None
        vocabulary = _vocabulary(source, used.view, config.seed) if has_words else None
        traverse, described_reference = describe_reference(source, reference, feature, vocabulary)

    with query.open() as opened:
        check_frames(opened, query.where, whole.dimensions, reference)
        described_query, readings, poses = describe_query_frames(opened, feature, vocabulary)
    drive, whole_drive = drive_in(opened, len(described_query.raws))
    if drive.odometry is not None:  # which assumes one metre from place to place
        traverse = replace(traverse, travelled=np.arange(len(traverse.raw), dtype=np.float64))
    CONSOLE.print("building our map")
    built, fitting = _fitting_map(traverse, config, feature.parts, thinned=drive.every > 1)
    placemap = used.in_map(built)
    references = source.unthinned_count if isinstance(source, Thinned) else placemap.places.count
    ground = find_truth(
        TruthSides(placemap, references, whole_drive, drive, poses, opened.origin, readings),
        lambda: truth_of(whole_drive, references, drive.every),
        asked,
    )
    if ground.truth is None:
        raise TruthError(f"no study without a truth: {ground.why_none}")
    return Trial(
        config=fitting.model_copy(update={"matching": query.matching(config.matching)}),
        traverse=traverse,
        parts=feature.parts,
        placemap=placemap,
        plain=plain_channel(placemap, traverse),
        reference=described_reference,
        query=described_query,
        descriptors=descriptors_of(placemap.model, described_query.raws),
        metres=Metres(placemap, readings),
        truth=ground.truth,
        ground=ground,
        jumps=drive.jumps,
        every=query.every,
        lowered_min_scale=None if fitting is config else fitting.scales.min_scale,
    )


def _agreed(query: Query, reference: Source) -> tuple[Query, Source]:
    """Return the query with its protocol's n, and the reference, thinned by n if needed."""
    if query.protocol not in TAKES_EVERY:
        return query, reference
    count = sum(1 for _ in reference)
    every = default_every(query.protocol, count) if query.every is None else query.every
    query = replace(query, every=every)
    if query.protocol not in THINS_REFERENCE:
        return query, reference
    return query, Thinned(reference, every, count)


def _fitting_map(
    traverse: Traverse, config: Config, parts: Sequence[FeaturePart], *, thinned: bool
) -> tuple[Map, Config]:
    """Build our map; if thinning left too few places, use shorter segments and log it.

    Returns:
        The map, and the configuration that it was built with.
    """
    tried = config
    while True:
        try:
            return build_reference(traverse, tried, parts), tried
        except MapError:
            shorter = tried.scales.min_scale - 1
            if not thinned or shorter < SHORTEST_MIN_SCALE or tried.scales.min_scale_metres:
                raise
        scales = tried.scales.model_copy(update={"min_scale": shorter})
        tried = tried.model_copy(update={"scales": scales})
        CONSOLE.print(f"the thinned reference is short: trying --min-scale {shorter}")


def _vocabulary(source: Source, view: View | None, seed: int) -> Vocabulary | None:
    """Learn FAB-MAP's words; None if the reference has no keypoints."""
    try:
        return learn_vocabulary(source, view, seed)
    except MapError:
        return None
