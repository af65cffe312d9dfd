"""Drives of known loops, made up and real."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.features.extract import feature_of
from placefield.matching.candidate import UNANSWERED
from placefield.matching.exploring import NEW, Answer, Explorer, SmoothedAnswer

Array = NDArray[np.float32]
CONFIG = MatchingConfig()


def route(places: int, seed: int = 0) -> Array:
    """Raw features of a route whose views change gradually, (places, 60)."""
    rng = np.random.default_rng(seed)
    views, view = np.zeros((places, 60), np.float32), rng.normal(size=60)
    for place in range(places):
        view = 0.7 * view + rng.normal(size=60)
        views[place] = view
    return views + 10


def passing(views: Array, *laps: Sequence[int], noise: float = 0.3) -> list[Array]:
    """Raw features of a drive that passes these places, each with noise of its own."""
    rng = np.random.default_rng(1)
    frames = np.concatenate([views[list(lap)] for lap in laps])
    return [*(frames + rng.normal(scale=noise, size=frames.shape)).astype(np.float32)]


def explored(
    raws: Sequence[Array | None], config: MatchingConfig = CONFIG
) -> tuple[list[Answer], list[Answer]]:
    """Return causal and smoothed answers."""
    explorer = Explorer(config)
    causal: list[Answer] = []
    smoothed: list[SmoothedAnswer] = []
    for raw in raws:
        causal.append(explorer.update(raw))
        smoothed += explorer.smoothed()
    smoothed += explorer.finish()
    assert [each.frame for each in smoothed] == [*range(len(raws))]
    assert all(0 <= each.lag <= config.lag for each in smoothed)
    return causal, [each.answer for each in smoothed]


def known(answers: Sequence[Answer]) -> list[int]:
    return [number for number, answer in enumerate(answers) if answer.known]


def test_a_drive_without_a_loop_has_only_new_places() -> None:
    causal, smoothed = explored(passing(route(400), range(400)))
    assert known(causal) == known(smoothed) == []
    assert min(answer.new for answer in causal[50:]) > 0.5


@pytest.mark.parametrize("laps", [2, 3, 4])
def test_every_later_lap_is_a_loop(laps: int) -> None:
    causal, smoothed = explored(passing(route(100), *[range(100)] * laps))
    for answers, least in ((causal, 0.85), (smoothed, 0.97)):
        loops = known(answers)
        assert min(loops) >= 100
        assert len(loops) >= least * 100 * (laps - 1)
        for frame in loops:
            off = abs(answers[frame].place % 100 - frame % 100)
            assert min(off, 100 - off) <= CONFIG.tolerance
            assert answers[frame].place < frame


def test_a_lap_at_another_speed_is_a_loop() -> None:
    causal, smoothed = explored(passing(route(160), range(160), range(0, 160, 2)))
    assert len(known(causal)) >= 0.7 * 80
    assert len(known(smoothed)) >= 0.9 * 80
    for frame in known(smoothed):
        assert abs(smoothed[frame].place - 2 * (frame - 160)) <= CONFIG.tolerance


def test_a_stretch_that_is_driven_in_reverse_is_no_loop() -> None:
    causal, smoothed = explored(passing(route(150), range(150), range(149, -1, -1)))
    assert known(causal) == known(smoothed) == []


def test_a_vehicle_that_stands_is_in_no_loop_however_long() -> None:
    causal, smoothed = explored(passing(route(100), range(60), [60] * 300, range(60, 100), noise=0))
    assert known(causal) == known(smoothed) == []


def test_a_vehicle_that_leaves_a_known_stretch_is_at_new_places_again() -> None:
    _, smoothed = explored(passing(route(260), range(150), range(40, 90), range(150, 260)))
    assert set(known(smoothed)) <= set(range(148, 204))
    assert len(known(smoothed)) >= 45


@pytest.mark.parametrize("end", [10, 60, 130, 171])
def test_no_answer_depends_on_a_later_frame(end: int) -> None:
    raws = passing(route(100), range(100), range(100))
    causal, smoothed = explored(raws)
    explorer = Explorer(CONFIG)
    part: list[Answer] = []
    for raw, answer in zip(raws[:end], causal, strict=False):
        assert explorer.update(raw) == answer
        part += [each.answer for each in explorer.smoothed()]
    assert part == smoothed[: len(part)]
    assert len(part) >= end - CONFIG.lag


def test_unobserved_frames_are_answered_and_become_no_place() -> None:
    raws: list[Array | None] = [*passing(route(100), range(100), range(100))]
    for number in (0, 30, 31, 120, 150, 151, 199):
        raws[number] = None
    causal, smoothed = explored(raws)
    assert len(causal) == len(smoothed) == 200
    assert not {answer.place for answer in causal} & {0, 30, 31, 120, 150, 151}
    assert len(known(smoothed)) >= 90


def test_skipped_frames_are_counted_but_not_answered() -> None:
    raws = passing(route(100), range(100), range(100))
    explorer = Explorer(CONFIG)
    skipped, smoothed = 10**12, []
    for number, raw in enumerate(raws):
        if number == 100:
            explorer.skip(skipped)
        answer = explorer.update(raw)
        smoothed += explorer.smoothed()
        assert answer.place < 100
    smoothed += explorer.finish()
    assert explorer.frames == skipped + 200
    assert [each.frame for each in smoothed] == [*range(100), *range(skipped + 100, skipped + 200)]
    assert sum(each.answer.known for each in smoothed) >= 90


@pytest.mark.parametrize("raws", [[], [None] * 80, [np.full(60, 3, np.float32)] * 80])
def test_a_drive_without_anything_to_observe_has_no_places(raws: list[Array | None]) -> None:
    causal, smoothed = explored(raws)
    assert causal == smoothed == [NEW] * len(raws)
    assert NEW.place == UNANSWERED


def test_probabilities_agree_with_each_other() -> None:
    for answers in explored(passing(route(90), range(90), range(90))):
        for answer in answers:
            assert 0 <= answer.probability <= 1 + 1e-6
            assert answer.new <= 1 - answer.probability + 1e-5
            assert answer.known == (answer.probability >= CONFIG.precision)


@cache
def features(folder: Path) -> list[Array]:
    describe = feature_of("gist").describe
    return [describe(file.read_bytes()) for file in sorted(folder.glob("*.jpg"))]


def recall(answers: Sequence[Answer], truth: dict[int, list[range]]) -> float:
    """Return the recall at 100 % precision."""
    right = [
        any(answer.place in places for places in truth.get(frame, ()))
        for frame, answer in enumerate(answers)
    ]
    wrong = [answer.probability for answer, ok in zip(answers, right, strict=True) if not ok]
    surest = max(wrong, default=0)
    return sum(
        ok and answer.probability > surest for answer, ok in zip(answers, right, strict=True)
    ) / len(truth)


@pytest.mark.slow
def test_the_laps_of_an_office_are_found(data_dir: Path) -> None:
    truth: dict[int, list[range]] = {}
    rows = (data_dir / "office" / "loops.csv").read_text().splitlines()[1:]
    for frame, first, last in (map(int, row.split(",")) for row in rows):
        truth.setdefault(frame, []).append(range(first, last + 1))
    causal, smoothed = explored(features(data_dir / "office" / "drive"))
    assert recall(causal, truth) >= 0.8
    assert recall(smoothed, truth) >= 0.95
    assert known(causal)[0] >= 40


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "first", "second", "causal", "smoothed"),
    [
        ("gardens_point", "day_left", "day_right", 0.9, 0.97),
        ("corridor", "ref", "query", 0.7, 0.9),
    ],
)
def test_a_second_lap_on_real_routes_is_found_and_a_first_has_no_loop(
    data_dir: Path, folder: str, first: str, second: str, causal: float, smoothed: float
) -> None:
    laps = [features(data_dir / folder / lap) for lap in (first, second)]
    start = len(laps[0])
    truth = {
        start + number: [range(max(number - 5, 0), number + 6)] for number in range(len(laps[1]))
    }
    answers = explored([*laps[0], *laps[1]])
    for each, least in zip(answers, (causal, smoothed), strict=True):
        assert recall(each, truth) >= least
        assert all(frame >= start for frame in known(each))
    for each in explored([*laps[0], *laps[1][::-1]]):
        assert known(each) == []
