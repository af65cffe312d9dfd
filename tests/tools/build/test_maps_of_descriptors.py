"""Frames that are descriptors, beside the images that the same descriptors are of."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield import (
    Config,
    ConfigError,
    Frame,
    FrameError,
    MapError,
    Recognizer,
    SourceError,
    build_map,
    open_map,
)
from placefield.features.extract import feature_of
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_tools.build.added_drive import add_drive
from placefield_tools.build.map_from_sources import build_from, map_of
from placefield_tools.build.used_part import AskedPart
from placefield_tools.cli.options_truth import truth_of
from placefield_tools.evaluate.evaluation import Evaluation, evaluate
from placefield_tools.evaluate.evaluation_plots import draw
from placefield_tools.evaluate.query import Query
from placefield_tools.evaluate.through_services import match_through_services
from placefield_tools.inspect.map_facts import map_facts
from placefield_tools.loops.finding import find_loops
from placefield_tools.sources import Parts, open_source

CONFIG = Config.model_validate({"scales": {"channels": 1}, "metric": {"kind": "identity"}})
GIST = feature_of("gist")

Save = Callable[[Path], str]


@pytest.fixture(scope="module")
def save(tmp_path_factory: pytest.TempPathFactory) -> Save:
    """Save the GIST of a folder's images as a file of descriptors; return its path."""
    folder = tmp_path_factory.mktemp("descriptors")

    def saved(images: Path) -> str:
        path = folder / f"{images.name}.npy"
        if not path.exists():
            files = sorted(images.iterdir())
            np.save(path, np.stack([GIST.describe(file.read_bytes()) for file in files]))
        return str(path)

    return saved


@pytest.fixture(scope="module")
def built(save: Save, reference_dir: Path) -> Map:
    return build_from([save(reference_dir)], CONFIG)


@pytest.fixture(scope="module")
def built_path(built: Map, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "route.pfmap"
    save_map(built, path)
    return path


def evaluated(map_path: Path, query: str) -> Evaluation:
    truth = partial(truth_of, tolerance=3, truth=None)
    return evaluate(map_path, Query(query), truth, CONFIG, services=False)


def test_a_map_of_descriptors_is_that_of_their_images_without_thumbnails(
    built: Map, reference_dir: Path
) -> None:
    of_images = build_from([str(reference_dir)], CONFIG)
    for name in ("mean", "deviation", "components"):
        assert np.array_equal(getattr(built.model, name), getattr(of_images.model, name))
    assert np.array_equal(built.channels[0].metric.places, of_images.channels[0].metric.places)
    assert np.array_equal(built.channels[0].labels, of_images.channels[0].labels)
    assert built.model.kind == built.features.kind == "descriptor"
    assert of_images.places.has_thumbnails
    assert not built.places.has_thumbnails
    assert built.places.thumbnail(3) == b""


def test_other_traverses_are_aligned_by_their_descriptors(
    save: Save, reference_dir: Path, query_dir: Path
) -> None:
    by_descriptors = build_from([save(reference_dir), save(query_dir)], CONFIG)
    by_images = build_from([str(reference_dir), str(query_dir)], CONFIG)
    assert np.array_equal(by_descriptors.alignments[1].places, by_images.alignments[1].places)


def test_a_later_drive_of_descriptors_is_added_and_one_of_images_refused(
    built_path: Path, save: Save, query_dir: Path
) -> None:
    add = partial(add_drive, spacing_m=None, parts=Parts(), leave_out_bad=False)
    added = add(open_map(built_path), save(query_dir), "query").map
    assert [each.name for each in added.traverses][1:] == ["query"]
    assert not added.places.has_thumbnails
    with pytest.raises(SourceError, match="holds images, and the map has descriptors of 512"):
        add(open_map(built_path), str(query_dir), "query")


def test_descriptors_are_evaluated_like_their_images(
    built_path: Path, save: Save, reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    by_descriptors = evaluated(built_path, save(query_dir))
    with map_of(str(reference_dir), CONFIG, feature_asked=False) as of_images:
        by_images = evaluated(of_images, str(query_dir))
    for rule, judged in by_images.results.items():
        assert np.array_equal(judged.places, by_descriptors.results[rule].places)
    assert by_descriptors.known["filter"] > 30
    pictures = draw(tmp_path / "plots", by_descriptors, "descriptors")
    assert [path.name for path in pictures] == ["precision-recall.png", "distances.png"]


def test_what_needs_images_is_refused_with_descriptors(save: Save, reference_dir: Path) -> None:
    descriptors = save(reference_dir)
    for asked in ("auto", "mask.png"):
        with pytest.raises(ConfigError, match=r"^--mask: needs images, .*; leave it out$"):
            build_from([descriptors], CONFIG, images=AskedPart(asked))
    local = Config.model_validate({"build": {"local_features": 100}})
    with pytest.raises(ConfigError, match=r"^setting build\.local_features: needs images"):
        build_from([descriptors], local)
    focal = Config.model_validate({"verification": {"focal": 0.8}})
    with pytest.raises(ConfigError, match=r"^setting verification\.focal: needs images"):
        find_loops(open_source((descriptors,)), descriptors, focal)


def test_a_map_of_descriptors_is_inspected_and_shown(built_path: Path) -> None:
    opened = open_map(built_path)
    assert map_facts(opened)["descriptor"].startswith("descriptor, standardised, 59 dimensions")
    assert "<img" not in opened._repr_html_()


def test_the_library_builds_and_recognises_by_frames_or_raw_features(
    built: Map, save: Save, reference_dir: Path, query_dir: Path
) -> None:
    with open_source(save(reference_dir)) as source, open_source(save(query_dir)) as query:
        config = CONFIG.model_copy(
            update={"features": CONFIG.features.model_copy(update={"kind": "descriptor"})}
        )
        in_library = build_map(source, config=config)
        by_frame, by_raw = Recognizer(in_library), Recognizer(built)
        for frame in query:
            match = by_frame.update_frame(frame)
            assert frame.descriptor is not None
            assert match == by_raw.update_raw(frame.descriptor)
    assert match.known
    with pytest.raises(FrameError, match="the map is of descriptors: give them to update_raw"):
        by_raw.update(np.zeros((48, 64), np.uint8))


def test_loops_are_found_in_descriptors_as_in_images(save: Save, reference_dir: Path) -> None:
    of_descriptors = find_loops(open_source(save(reference_dir)), "descriptors", CONFIG)
    of_images = find_loops(open_source(str(reference_dir)), "images", CONFIG)
    assert of_descriptors.smoothed == of_images.smoothed


def test_a_frame_that_is_not_finite_ends_the_build_or_is_left_out(
    save: Save, reference_dir: Path, tmp_path: Path
) -> None:
    vectors = np.load(save(reference_dir))
    vectors[7, 7] = np.inf
    np.save(tmp_path / "drive.npy", vectors)
    with pytest.raises(SourceError, match=r"drive\.npy#7: the descriptor is not finite; .*leave-o"):
        build_from([str(tmp_path / "drive.npy")], CONFIG)
    assert build_from([str(tmp_path / "drive.npy")], CONFIG, leave_out_bad=True).places.count == 59


@pytest.fixture
def narrow(tmp_path: Path) -> str:
    """Descriptors of another dimension."""
    np.save(tmp_path / "narrow.npy", np.random.default_rng(0).normal(size=(60, 20)))
    return str(tmp_path / "narrow.npy")


def test_frames_that_do_not_fit_a_map_are_one_line(
    built_path: Path, map_path: Path, save: Save, query_dir: Path, narrow: str
) -> None:
    with pytest.raises(SourceError, match=r"holds images, and route\.pfmap has descriptors of 512"):
        evaluated(built_path, str(query_dir))
    with pytest.raises(SourceError, match=r"holds descriptors of 512 dim.*, and .* has images; g"):
        evaluated(map_path, save(query_dir))
    with pytest.raises(SourceError, match=r"holds descriptors of 20 .* has descriptors of 512 dim"):
        evaluated(built_path, narrow)


def refuse(references: Sequence[str], config: Config, reason: str) -> None:
    with pytest.raises((SourceError, MapError), match=reason):
        build_from(references, config)


def test_references_that_do_not_go_together_are_one_line(
    save: Save, reference_dir: Path, narrow: str
) -> None:
    wide = save(reference_dir)
    refuse([wide, narrow], CONFIG, r"narrow\.npy: holds descriptors of 20 dimensions, and .*512")
    refuse([wide, str(reference_dir)], CONFIG, "holds images, and .*npy has descriptors of 512")
    for kind, where, reason in (
        ("grayscale", wide, "holds descriptors, which grayscale cannot describe; leave it out"),
        ("descriptor", str(reference_dir), "holds images; leave --feature descriptor out"),
    ):
        features = CONFIG.features.model_copy(update={"kind": kind})
        refuse([where], CONFIG.model_copy(update={"features": features}), reason)


def test_traverses_of_another_dimension_are_refused_by_the_library() -> None:
    features = CONFIG.features.model_copy(update={"kind": "descriptor"})
    config = CONFIG.model_copy(update={"features": features})

    def drive(dimensions: int) -> list[NDArray[np.float32]]:
        return [*np.random.default_rng(1).normal(size=(20, dimensions)).astype(np.float32)]

    frames = [
        [Frame(at, at, str(at), descriptor=vector) for at, vector in enumerate(drive(of))]
        for of in (8, 9)
    ]
    with pytest.raises(MapError, match="traverse 1: features of 9 dimensions, and those of"):
        build_map(*frames, config=config)


def test_the_services_match_descriptors_as_this_process_does(
    built_path: Path, save: Save, query_dir: Path
) -> None:
    with open_source(save(query_dir)) as source:
        recognizer = Recognizer(open_map(built_path), CONFIG)
        here = [recognizer.update_frame(frame) for frame in source]
        smoothed = [*recognizer.smoothed(), *recognizer.finish()]
        there, smoothed_there = match_through_services(built_path, source, CONFIG)
    assert there == here
    assert [match.match for match in smoothed_there] == [match.match for match in smoothed]
