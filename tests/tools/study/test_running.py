from pathlib import Path
from shutil import copy, copytree

import cv2
import numpy as np
import pytest

from placefield.baselines.seqslam import seqslam_image
from placefield.config import Config
from placefield.errors import MapError, SourceError
from placefield.evaluation.protocols import Protocol, drive_of
from placefield.evaluation.truth import Truth
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of
from placefield.features.images import decode, grey
from placefield.matching.roads import RouteCells
from placefield_tools.evaluate.query import Query
from placefield_tools.study.matching import match_channels
from placefield_tools.study.methods import methods_of, run_methods
from placefield_tools.study.run_study import prepare
from placefield_tools.study.trial import Trial


@pytest.fixture(autouse=True)
def _few_words(few_words: object) -> None:
    """Learn a small vocabulary, at once."""


def within_3(queries: int, references: int, every: int) -> Truth:
    return Truth.within(queries, references, 3, every)


CONFIG = Config.model_validate({"scales": {"channels": 1}})


@pytest.mark.parametrize("protocol", ["kidnap", "off-route", "sparse"])
def test_a_protocol_puts_what_every_method_needs_in_the_same_order(
    trial: Trial, reference_dir: Path, query_dir: Path, protocol: Protocol
) -> None:
    query = Query(
        str(query_dir), None, protocol, str(reference_dir) if protocol == "off-route" else None, 5
    )
    prepared = prepare(str(reference_dir), query, within_3, CONFIG)

    drive = drive_of(protocol, 60, foreign_count=60, seed=5)
    routes = (trial.query, trial.reference)
    taken = [(routes[int(f)], n) for f, n in zip(drive.foreign, drive.frames, strict=True)]
    assert prepared.query.images.tolist() == [r.images[n].tolist() for r, n in taken]
    assert prepared.query.words.tolist() == [r.words[n].tolist() for r, n in taken]
    stream = DescriptorStream(prepared.placemap.model)
    for (route, number), vector in zip(taken, prepared.descriptors, strict=True):
        raw = route.raws[number]
        assert raw is not None
        assert vector is not None
        assert np.array_equal(vector, stream.update(raw))
    assert prepared.jumps.tolist() == drive.jumps.tolist()
    assert prepared.truth.on_route.tolist() == (~drive.foreign).tolist()


@pytest.mark.parametrize(("protocol", "every", "n"), [("speed", None, 2), ("dense", 3, 3)])
def test_a_thinned_reference_is_all_that_is_known_of_it(
    trial: Trial,
    reference_dir: Path,
    query_dir: Path,
    protocol: Protocol,
    every: int | None,
    n: int,
) -> None:
    query = Query(str(query_dir), protocol=protocol, seed=3, every=every)
    thinned = prepare(str(reference_dir), query, within_3, CONFIG)

    assert thinned.every == n
    assert np.array_equal(thinned.traverse.raw, trial.traverse.raw[::n])
    assert np.array_equal(thinned.reference.images, trial.reference.images[::n])
    assert thinned.places == thinned.placemap.places.count == 60 // n
    for frame, right in enumerate(drive_of(protocol, 60, foreign_count=0, seed=3, every=n).frames):
        for place in range(thinned.places):
            matches = np.full(len(thinned.query.raws), place)
            assert thinned.truth.correct(matches)[frame] == (abs(right / n - place) <= 3)


def test_with_odometry_places_are_a_metre_apart_and_our_matchers_are_reported_the_readings(
    trial: Trial,
    reference_dir: Path,
    query_dir: Path,
    given_odometry: list[float | None],
    given_cells: list[RouteCells | None],
) -> None:
    query = Query(str(query_dir), protocol="odometry", seed=3)
    prepared = prepare(str(reference_dir), query, within_3, CONFIG)
    assert prepared.every == 2
    assert prepared.metres.placemap.places.travelled.tolist() == [*range(30)]
    for placemap in (prepared.placemap, prepared.published, prepared.multiscale):
        assert placemap.places.travelled.tolist() == [*range(30)]
    drive = drive_of("odometry", 60, foreign_count=0, seed=3, every=2)
    assert drive.odometry is not None
    assert prepared.metres.readings == drive.odometry.tolist()
    given_odometry.clear()  # of the search for places that are the same
    match_channels(
        prepared.placemap.channels,
        prepared.descriptors,
        prepared.metres,
        prepared.matching("filter"),
    )
    assert given_odometry == drive.odometry.tolist()
    assert given_cells[-1] is not None
    assert given_cells[-1].middles.tolist() == [*range(30)]
    assert trial.metres.readings == [None] * 60
    assert not len(trial.metres.placemap.places.travelled)


def test_a_frame_of_a_stop_is_described_from_its_own_picture_for_every_method(
    trial: Trial, reference_dir: Path, query_dir: Path
) -> None:
    query = Query(str(query_dir), protocol="speed", seed=10, every=2)
    study = prepare(str(reference_dir), query, within_3, CONFIG).query
    drive = drive_of("speed", 60, foreign_count=0, seed=10, every=2)
    repeated = np.flatnonzero(drive.repeated)
    assert len(repeated) >= 3
    with query.open() as source:
        pixels = [decode(frame.image) for frame in source if isinstance(frame.image, bytes)]
    for at in repeated:
        raw = study.raws[at]
        assert raw is not None
        assert np.array_equal(raw, feature_of("gist").describe(pixels[at]))
        unlike = [np.linalg.norm(raw - one) for one in trial.query.raws if one is not None]
        assert np.argmin(unlike) == drive.frames[at]
        assert min(unlike) > 0
        assert np.array_equal(study.images[at], seqslam_image(grey(pixels[at])))
    # Noise moves keypoints, so that FAB-MAP sees other words.
    before = study.words[np.searchsorted(drive.frames, drive.frames[repeated])]
    assert (study.words[repeated] != before).any()


def test_a_thinned_reference_that_is_short_is_cut_into_shorter_segments(
    trial: Trial, reference_dir: Path, query_dir: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    query = Query(str(query_dir), protocol="dense", every=5)  # 12 places
    short = prepare(str(reference_dir), query, within_3, CONFIG)
    assert short.config.scales.min_scale == short.lowered_min_scale == 3
    assert "--min-scale 3" in capfd.readouterr().err
    failed = {result.name for result in run_methods(short, methods_of(short)) if result.failure}
    assert failed == {"MS", "AMS as published"}  # neither lowers what is published
    assert trial.lowered_min_scale is None


def test_a_query_frame_that_cannot_be_read_is_one_that_was_not_seen(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    damaged = copytree(query_dir, tmp_path / "damaged")
    (damaged / "0007.jpg").write_bytes(b"no image")
    trial = prepare(str(reference_dir), Query(str(damaged)), within_3, CONFIG)
    assert np.flatnonzero(~trial.query.observed).tolist() == [7]
    assert trial.descriptors[7] is None
    assert not trial.query.words[7].any()


def test_a_reference_frame_that_cannot_be_read_is_named(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    damaged = copytree(reference_dir, tmp_path / "damaged")
    (damaged / "0007.jpg").write_bytes(b"no image")
    with pytest.raises(SourceError, match=r"0007\.jpg"):
        prepare(str(damaged), Query(str(query_dir)), within_3, CONFIG)


def test_a_reference_without_keypoints_leaves_no_words(query_dir: Path, tmp_path: Path) -> None:
    for number in range(40):
        ramp = np.tile(np.linspace(number, 3 * number + 9, 96, dtype=np.uint8), (72, 1))
        cv2.imwrite(str(tmp_path / f"{number:02}.png"), ramp)
    trial = prepare(str(tmp_path), Query(str(query_dir)), within_3, CONFIG)
    assert trial.reference.words.shape == (40, 0)
    assert trial.query.words.shape == (60, 0)


def test_a_reference_that_is_too_short_for_our_map_is_refused(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    for file in sorted(reference_dir.iterdir())[:6]:
        copy(file, tmp_path)
    with pytest.raises(MapError, match="too short"):
        prepare(str(tmp_path), Query(str(query_dir)), within_3, CONFIG)


def test_descriptors_run_through_every_method_that_needs_no_image(
    trial: Trial, tmp_path: Path
) -> None:
    paths = []
    for name, frames in (("reference", trial.reference), ("query", trial.query)):
        paths.append(str(tmp_path / f"{name}.npy"))
        raws = np.array(frames.raws)
        raws[7] *= 1 if name == "reference" else np.nan
        np.save(paths[-1], raws)
    prepared = prepare(paths[0], Query(paths[1]), within_3, CONFIG)
    assert prepared.config.features.kind == "descriptor"
    assert np.flatnonzero(~prepared.query.observed).tolist() == [7]
    wanted = ("SeqSLAM", "FAB-MAP", "one frame", "Placefield, filter")
    methods = [method for method in methods_of(prepared) if method.name in wanted]
    failures = {result.name: result.failure for result in run_methods(prepared, methods)}
    assert failures == {
        "one frame": None,
        "SeqSLAM": "the frames are descriptors, and SeqSLAM compares images",
        "FAB-MAP": "the frames are descriptors, and FAB-MAP looks for keypoints in images",
        "Placefield, filter": None,
    }
