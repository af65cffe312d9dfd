"""A reference and a query to a study."""

from dataclasses import replace

from placefield.baselines.fabmap import Vocabulary
from placefield.config import Config
from placefield.errors import MapError, SourceError
from placefield.evaluation.protocols import drive_of
from placefield.features.extract import feature_of
from placefield.maps.metrics import identity_metric
from placefield_tools.evaluating import Query, TruthOf
from placefield_tools.progress import CONSOLE
from placefield_tools.sources import Source, open_source
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.study.ablation import ablate
from placefield_tools.study.channel_counts import count_channels
from placefield_tools.study.describing import (
    Described,
    describe_query_frames,
    describe_reference,
    learn_vocabulary,
)
from placefield_tools.study.methods import run_methods
from placefield_tools.study.results import CountResult, Study
from placefield_tools.study.scales import compare_scales
from placefield_tools.study.trial import (
    Trial,
    build_reference,
    descriptors_of,
)


def run_study(
    reference: str, query: Query, truth_of: TruthOf, config: Config, *, tolerance: int | None
) -> Study:
    """Run every method on the same frames, showing progress.

    Args:
        reference: source of the reference's frames.
        query: to match, and how it is driven.
        truth_of: gives the truth for so many query frames, in their own order, and places.
        config: of our map, its matching and all that is random.
        tolerance: for the record; None where a ground truth was given.

    Raises:
        PlacefieldError: the sources or the truth cannot be read, or do not make our map. Another
            method that fails is reported, and the others go on.
    """
    trial = prepare(reference, query, truth_of, config)
    return Study(
        reference=reference,
        query=query.where,
        protocol=query.protocol,
        seed=config.seed,
        tolerance=tolerance,
        placemap=trial.placemap,
        methods=run_methods(trial),
        counts=_counts(trial),
        scales=compare_scales(trial),
        ablation=ablate(trial),
    )


def prepare(reference: str, query: Query, truth_of: TruthOf, config: Config) -> Trial:
    """Describe all frames once, build our map, and drive the query; see ``run_study``."""
    feature = feature_of(config.features.kind)
    with open_source(reference, spacing_m=query.spacing_m, parts=query.parts) as source:
        vocabulary = _vocabulary(source, reference, config.seed)
        traverse, described_reference = describe_reference(source, reference, feature, vocabulary)

    def describe(where: str) -> Described:
        with open_source(where, spacing_m=query.spacing_m, parts=query.parts) as source:
            return describe_query_frames(source, feature, vocabulary)

    described_query = describe(query.where)
    foreign = describe(query.other) if query.other is not None else None
    drive = drive_of(
        query.protocol,
        len(described_query.raws),
        foreign_count=len(foreign.raws) if foreign else 0,
        seed=query.seed,
    )
    CONSOLE.print("building our map")
    placemap = build_reference(traverse, config, feature.network)
    truth = truth_of(len(described_query.raws), placemap.places.count)
    driven = described_query.along(drive, foreign)
    return Trial(
        config=config.model_copy(update={"matching": query.matching(config.matching)}),
        traverse=traverse,
        network=feature.network,
        placemap=placemap,
        plain=replace(
            placemap.channels[0],
            metric=identity_metric(placemap.model.of_reference(traverse.raw)),
        ),
        reference=described_reference,
        query=driven,
        descriptors=descriptors_of(placemap.model, driven.raws),
        truth=truth.along(drive.frames, drive.foreign),
        jumps=drive.jumps,
    )


def _vocabulary(source: Source, name: str, seed: int) -> Vocabulary | None:
    """Learn FAB-MAP's words; None where the reference has none."""
    if source.live:
        camera = without_secrets(name)
        raise SourceError(f"{camera}: a camera gives no second look; record a traverse")
    try:
        return learn_vocabulary(source, seed)
    except MapError:
        return None


def _counts(trial: Trial) -> tuple[CountResult, ...]:
    try:
        return count_channels(trial)
    except MapError as error:
        CONSOLE.print(f"no combinations of channels: {error}", soft_wrap=True)
        return ()
