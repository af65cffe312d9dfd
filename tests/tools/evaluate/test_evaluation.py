from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from frame_folders import uneven_drive

from placefield.config import Config
from placefield.errors import SourceError, TruthError
from placefield.evaluation.protocols import Protocol, drive_of
from placefield.evaluation.truth import Truth
from placefield.features.extract import feature_of_model
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import Map
from placefield.matching.matcher import WHOLE_DRIVE
from placefield_tools.evaluate.evaluation import describe_query, evaluate
from placefield_tools.evaluate.judging import judge, judge_smoothed
from placefield_tools.evaluate.query import Query
from placefield_tools.evaluate.truth_source import TruthOptions
from placefield_tools.sources import Parts, open_source


def within_3(queries: int, places: int) -> Truth:
    return Truth.within(queries, places, 3)


def test_a_frame_that_cannot_be_read_is_named_and_has_no_feature(
    route_map: Map, damaged_query: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with open_source(str(damaged_query)) as source:
        raws, _, _ = describe_query(source, feature_of_model(route_map.model).of_frame)
    assert [number for number, raw in enumerate(raws) if raw is None] == [20, 21]
    captured = capfd.readouterr()
    assert "0020.jpg" in captured.err
    assert "0021.jpg" in captured.err
    assert not captured.out


def test_a_query_without_a_frame_that_can_be_read_is_refused(
    route_map: Map, tmp_path: Path
) -> None:
    for number in range(3):
        (tmp_path / f"{number}.jpg").write_bytes(b"no image")
    with (
        open_source(str(tmp_path)) as source,
        pytest.raises(SourceError, match=r"0\.jpg.*no frame that can be read"),
    ):
        describe_query(source, feature_of_model(route_map.model).of_frame)


def test_every_lag_is_judged_and_more_of_it_waits_longer(map_path: Path, query_dir: Path) -> None:
    config = Config.model_validate({"matching": {"lag": 7}})
    evaluation = evaluate(map_path, Query(str(query_dir)), within_3, config, services=False)
    assert evaluation.lag == 7
    for smoothed in evaluation.smoothed.values():
        assert [*smoothed] == [7, 10, 20, WHOLE_DRIVE]
        mean_lags = [judged.mean_lag for judged in smoothed.values()]
        assert mean_lags == sorted(mean_lags)
        assert all(len(judged.places) == 60 for judged in smoothed.values())
    assert evaluation.smoothed["filter"][WHOLE_DRIVE].correct.all()


def test_without_a_lag_in_force_the_causal_matches_stand_for_it(
    map_path: Path, query_dir: Path
) -> None:
    config = Config.model_validate({"matching": {"lag": 0}})
    evaluation = evaluate(map_path, Query(str(query_dir)), within_3, config, services=False)
    assert [*evaluation.smoothed["filter"]] == [10, 20, WHOLE_DRIVE]


def test_judging_smoothed_matches_averages_their_lags() -> None:
    matches = [SmoothedMatch(0, Match(0, 2.0), 4), SmoothedMatch(1, Match(9, 1.0), 1)]
    result = judge_smoothed(matches, Truth.within(2, 20, 2))
    assert result.correct.tolist() == [True, False]
    assert result.mean_lag == 2.5


def test_the_route_is_recognised_by_every_rule(map_path: Path, query_dir: Path) -> None:
    evaluation = evaluate(map_path, Query(str(query_dir)), within_3, Config(), services=False)
    for result in evaluation.results.values():
        answered = result.places >= 0
        assert answered.sum() > 50
        assert result.correct[answered].all()
    assert evaluation.results["evidence"].curve.recall_at_1 == 1.0


def test_an_uneven_drive_is_judged_as_the_even_one_when_it_is_spaced(
    map_path: Path, query_dir: Path, tmp_path: Path
) -> None:
    uneven = str(uneven_drive(query_dir, tmp_path / "uneven"))
    config = Config()
    even = evaluate(map_path, Query(str(query_dir)), within_3, config, services=False)
    spaced = evaluate(map_path, Query(uneven, spacing_m=0.1), within_3, config, services=False)
    for rule, result in even.results.items():
        assert np.array_equal(result.scores, spaced.results[rule].scores)
        assert np.array_equal(result.correct, spaced.results[rule].correct)


def test_a_truth_for_another_query_is_refused(map_path: Path, query_dir: Path) -> None:
    with pytest.raises(TruthError):
        evaluate(
            map_path,
            Query(str(query_dir)),
            lambda _, places: within_3(7, places),
            Config(),
            services=False,
        )


def test_judging_keeps_places_and_scores_and_counts_no_answer_as_wrong() -> None:
    matches = [Match(0, 2.0), Match(-1, 0.0), Match(9, 1.0), Match(5, 0.5)]
    result = judge(matches, Truth.within(4, 20, 2))
    assert result.places.tolist() == [0, -1, 9, 5]
    assert result.scores.tolist() == [2.0, 0.0, 1.0, 0.5]
    assert result.correct.tolist() == [True, False, False, True]
    assert result.curve.recall_at_1 == pytest.approx(0.5)


def test_the_services_find_what_is_found_here(map_path: Path, damaged_query: Path) -> None:
    files = sorted(damaged_query.iterdir())
    rows = [f"{file.name},{number}" for number, file in enumerate(files)]
    (damaged_query / "frames.csv").write_text("\n".join(["file,odometry", *rows]))
    here, there = (
        evaluate(map_path, Query(str(damaged_query)), within_3, Config(), services=services)
        for services in (False, True)
    )
    for rule, result in here.results.items():
        assert np.array_equal(result.places, there.results[rule].places)
        assert np.array_equal(result.scores, there.results[rule].scores)


@pytest.mark.parametrize("protocol", ["aligned", "sparse"])
def test_what_a_query_knows_of_its_odometry_goes_to_the_matchers(
    map_path: Path,
    query_dir: Path,
    tmp_path: Path,
    given_odometry: list[float | None],
    protocol: Protocol,
) -> None:
    files = sorted(copytree(query_dir, tmp_path / "measured").iterdir())
    rows = [f"{file.name},{10 + number / 2}" for number, file in enumerate(files)]
    (tmp_path / "measured" / "frames.csv").write_text("\n".join(["file,odometry", *rows]))
    files[7].write_bytes(b"no image")
    query = Query(str(tmp_path / "measured"), protocol=protocol, every=4)
    evaluate(map_path, query, within_3, Config(), services=False)
    expected = [n / 2 for n in range(0, 60, 4)]
    if protocol == "aligned":
        expected = [10 + n / 2 for n in range(60)]
    assert given_odometry == expected  # once for all lags


def test_a_route_that_is_driven_the_other_way_is_recognised(
    map_path: Path, query_dir: Path
) -> None:
    query = Query(str(query_dir), protocol="reverse")
    evaluation = evaluate(map_path, query, within_3, Config(), services=False)
    for result in evaluation.results.values():
        assert result.correct[-20:].all()


def test_frames_off_the_route_are_those_of_the_other_and_never_right(
    map_path: Path, query_dir: Path, reference_dir: Path
) -> None:
    query = Query(str(query_dir), protocol="off-route", other=str(reference_dir), seed=1)
    evaluation = evaluate(map_path, query, within_3, Config(), services=False)
    drive = drive_of("off-route", 60, foreign_count=60, seed=1)
    assert len(evaluation.descriptors) == len(drive.frames)
    for result in evaluation.results.values():
        assert not result.correct[drive.foreign].any()
        assert result.curve.on_route == 60


@pytest.mark.parametrize(
    "parts", [Parts(start=10, stop=50, stride=2), Parts(start=31), Parts(stop=25)]
)
def test_frames_of_a_query_that_is_cut_keep_their_numbers(
    map_path: Path, query_dir: Path, parts: Parts
) -> None:
    asked = TruthOptions(3)
    cut = evaluate(
        map_path,
        Query(str(query_dir), parts=parts),
        within_3,
        Config(),
        services=False,
        asked=asked,
    )
    numbers = range(60)[parts.start : parts.stop : parts.stride]
    assert len(cut.descriptors) == len(numbers)
    assert cut.ground.by == "aligned"
    assert cut.ground.truth is not None
    right = Truth.within(60, 60, 3)
    for at, number in enumerate(numbers):
        for place in range(60):
            [one] = cut.ground.truth.correct(np.full(len(numbers), place))[[at]]
            assert one == right.correct(np.full(60, place))[number]


def test_a_query_that_is_cut_is_judged_by_a_truth_of_all_its_frames(
    map_path: Path, query_dir: Path
) -> None:
    reported = []

    def truth_of(queries: int, places: int) -> Truth:
        reported.append((queries, places))
        return within_3(queries, places)

    query = Query(str(query_dir), parts=Parts(start=20, stop=40, stride=3))
    evaluation = evaluate(map_path, query, truth_of, Config(), services=False)
    assert reported == [(60, 60)]
    assert evaluation.results["filter"].claims is not None
    assert evaluation.results["filter"].claims.precision == 1
