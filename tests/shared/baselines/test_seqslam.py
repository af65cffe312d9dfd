"""SeqSLAM against its definition, pixel by pixel, and against what is published of it."""

import math
import statistics
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.baselines.seqslam import (
    HEIGHT,
    WIDTH,
    SeqSlam,
    image_differences,
    match_sequences,
    seqslam,
    seqslam_image,
)
from placefield.errors import ConfigError
from placefield.evaluation.curves import PrecisionRecall, precision_recall
from placefield.evaluation.truth import Truth
from placefield.fusion.match import Match

Images = NDArray[np.float32]


def images_of(frames: int, seed: int, *, height: int = 4, width: int = 6) -> Images:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (frames, height, width)).astype(np.float32)


def reference_normalised(image: Images, patch: int) -> list[list[float]]:
    height, width = image.shape
    out = [[0.0] * width for _ in range(height)]
    for top in range(0, height, patch):
        for left in range(0, width, patch):
            cells = [(top + y, left + x) for y in range(patch) for x in range(patch)]
            values = [float(image[cell]) for cell in cells]
            deviation = statistics.pstdev(values)
            for (y, x), value in zip(cells, values, strict=True):
                out[y][x] = (value - statistics.mean(values)) / deviation if deviation else 0.0
    return out


def reference_differences(reference: Images, query: Images, patch: int) -> list[list[float]]:
    places = [reference_normalised(image, patch) for image in reference]
    frames = [reference_normalised(image, patch) for image in query]
    _, height, width = reference.shape
    return [
        [
            sum(abs(a[y][x] - b[y][x]) for y in range(height) for x in range(width))
            / (height * width)
            for b in places
        ]
        for a in frames
    ]


def reference_contrast(row: list[float], window: int) -> list[float]:
    out = []
    for j, own in enumerate(row):
        around = row[max(0, j - window // 2) : j + window // 2 + 1]
        deviation = statistics.stdev(around)
        n = 2 * (window // 2) + 1
        lowest = -(n - 1) / math.sqrt(n)
        out.append((own - statistics.mean(around)) / deviation - lowest)
    return out


def reference_match(D: list[list[float]], t: int, settings: SeqSlam, lag: int) -> Match:
    places = len(D[0])
    sums = [math.inf] * places
    later = min(lag, settings.length // 2)
    frames = range(t + later - settings.length + 1, t + later + 1)
    for j in range(places):
        for speed in settings.speeds:
            cells = [(frame, j + round(speed * (frame - t))) for frame in frames]
            if all(0 <= frame < len(D) and 0 <= place < places for frame, place in cells):
                sums[j] = min(sums[j], sum(D[frame][place] for frame, place in cells))
    best = min(sums)
    if best == math.inf:
        return Match(-1, 0.0)
    match = sums.index(best)
    outside = [
        total
        for j, total in enumerate(sums)
        if abs(j - match) > settings.neighbourhood_window // 2 and total < math.inf
    ]
    return Match(match, min(outside) / best if outside else 1.0)


@pytest.mark.parametrize(
    "settings",
    [
        SeqSlam(patch=2, length=3),
        SeqSlam(patch=2, length=6, contrast_window=4, neighbourhood_window=3),
        SeqSlam(patch=2, length=4, contrast_window=0),
        SeqSlam(patch=2, length=12, speeds=(0.5, 1.0, 2.0)),
    ],
)
@pytest.mark.parametrize("lag", [0, 1, 20])
def test_is_its_definition_written_out(settings: SeqSlam, lag: int) -> None:
    reference, query = images_of(25, 1), images_of(16, 2)
    reference[7, :2, :2] = 90  # a flat patch
    D = reference_differences(reference, query, settings.patch)
    if settings.contrast_window:
        D = [reference_contrast(row, settings.contrast_window) for row in D]
    matches = seqslam(reference, query, settings, lag)
    assert len(matches) == 16
    for t, match in enumerate(matches):
        expected = reference_match(D, t, settings, lag)
        assert match.place == expected.place
        assert match.score == pytest.approx(expected.score, rel=1e-5)


def test_the_same_traverse_is_recognised_from_the_first_trajectory_on() -> None:
    images = images_of(60, 3, height=HEIGHT, width=WIDTH)
    matches = seqslam(images, images)
    assert [match.place for match in matches] == [-1] * 14 + list(range(14, 60))
    assert min(match.score for match in matches[14:]) > 2


def test_as_published_a_trajectory_is_centred_and_passes_the_matched_frame_in_its_middle() -> None:
    images = images_of(60, 3, height=HEIGHT, width=WIDTH)
    matches = seqslam(images, images, lag=7)
    assert [match.place for match in matches] == [-1] * 7 + list(range(7, 53)) + [-1] * 7
    assert matches == seqslam(images, images, lag=20)


def test_brightness_and_gain_do_not_matter() -> None:
    reference = images_of(40, 4, height=HEIGHT, width=WIDTH)
    matches = seqslam(reference, 0.25 * reference + 30)
    assert [match.place for match in matches[14:]] == list(range(14, 40))


def test_nothing_after_a_frame_changes_its_match() -> None:
    reference, query = images_of(30, 5, height=8, width=8), images_of(30, 6, height=8, width=8)
    assert seqslam(reference, query[:20]) == seqslam(reference, query)[:20]


def test_where_all_places_are_alike_no_match_is_unique() -> None:
    standstill = np.repeat(images_of(1, 0, height=8, width=8), 40, axis=0)
    for query in (standstill, images_of(40, 1, height=8, width=8), np.zeros_like(standstill)):
        assert {match.score for match in seqslam(standstill, query)[14:]} == {1.0}


def test_patches_that_do_not_tile_the_images_are_refused() -> None:
    with pytest.raises(ConfigError, match="8×8 pixels do not tile images of 12×8"):
        seqslam(images_of(3, 0, height=8, width=12), images_of(3, 0, height=8, width=12))


def test_images_are_made_small() -> None:
    grey = np.repeat(np.repeat(images_of(1, 0, height=HEIGHT, width=WIDTH)[0], 3, 0), 2, 1)
    np.testing.assert_allclose(seqslam_image(grey), grey[::3, ::2], rtol=1e-6)


@pytest.fixture(scope="module")
def nordland_differences(data_dir: Path) -> Images:
    summer, winter = (
        np.stack(
            [
                seqslam_image(np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.float32))
                for file in sorted((data_dir / "nordland" / season).iterdir())[:1200]
            ]
        )
        for season in ("summer", "winter")
    )
    return image_differences(summer, winter, patch=8)


def curve_of(differences: Images, settings: SeqSlam) -> PrecisionRecall:
    matches = match_sequences(differences, settings)
    places = np.array([match.place for match in matches])
    queries, count = differences.shape
    truth = Truth.within(queries, count, tolerance=10)
    scores = np.array([match.score for match in matches])
    return precision_recall(truth.correct(places), places >= 0, truth.on_route, scores)


def test_on_nordland_longer_trajectories_recognise_more(
    nordland_differences: Images,
) -> None:
    """On all 3576 frames the published AUC at one speed is .62, .83 and .94."""
    auc = {
        length: curve_of(nordland_differences, SeqSlam(length=length, speeds=(1.0,))).auc
        for length in (10, 20, 40)
    }
    assert 0.7 < auc[10] < auc[20] - 0.05 < auc[40] - 0.09
    assert auc[40] > 0.93


def test_on_nordland_it_needs_local_contrast(
    nordland_differences: Images,
) -> None:
    enhanced = curve_of(nordland_differences, SeqSlam())
    plain = curve_of(nordland_differences, SeqSlam(contrast_window=0))
    assert enhanced.auc > 0.8
    assert enhanced.recall_at_100_precision > 0.7
    assert plain.auc < 0.1
