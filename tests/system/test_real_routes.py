"""Real frames, default settings: what the README's tables say, held from below."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import pytest

from placefield.config import Config, Rule
from placefield.evaluation.curves import PrecisionRecall
from placefield.evaluation.truth import Truth
from placefield.maps.opening import open_map
from placefield_tools.build.map_from_sources import map_of
from placefield_tools.cli import options_truth
from placefield_tools.evaluate.evaluation import Evaluation, evaluate
from placefield_tools.evaluate.judging import judge
from placefield_tools.evaluate.query import Query
from placefield_tools.study.matching import match_channels
from placefield_tools.study.run_study import prepare


@dataclass(frozen=True)
class Route:
    """A reference, a query of it, and recall at 100 % precision and AUC that they must reach.

    As driven, smoothed and at once; then at once at a speed that varies, without and with odometry.
    """

    reference: str
    query: str
    tolerance: int
    smoothed: tuple[float, float]
    aligned: tuple[float, float]
    speed: tuple[float, float]
    odometry: tuple[float, float]


ROUTES = [
    Route(
        "gardens_point/day_left",
        "gardens_point/day_right",
        tolerance=3,
        smoothed=(0.99, 0.99),
        aligned=(0.97, 0.98),
        speed=(0.80, 0.97),
        odometry=(0.95, 0.98),
    ),
    Route(
        "gardens_point/day_right",
        "gardens_point/night_right",
        tolerance=3,
        smoothed=(0.99, 0.99),
        aligned=(0.99, 0.99),
        speed=(0.80, 0.97),
        odometry=(0.95, 0.98),
    ),
    Route(
        "gardens_point/day_left",
        "gardens_point/night_right",
        tolerance=3,
        smoothed=(0.99, 0.99),
        aligned=(0.97, 0.97),
        speed=(0.30, 0.85),
        odometry=(0.92, 0.93),
    ),
    Route(
        "nordland/summer",
        "nordland/winter",
        tolerance=4,
        smoothed=(0.98, 0.98),
        aligned=(0.92, 0.92),
        speed=(0.30, 0.80),
        odometry=(0.88, 0.92),
    ),
    Route(
        "corridor/ref",
        "corridor/query",
        tolerance=2,
        smoothed=(0.99, 0.99),
        aligned=(0.92, 0.92),
        speed=(0.50, 0.85),
        odometry=(0.95, 0.98),
    ),
]


class OnRoute:
    """A route's map, and queries of it."""

    def __init__(self, data_dir: Path, route: Route, map_path: Path, config: Config) -> None:
        self.route = route
        self._map_path = map_path
        self._config = config
        self._query = str(data_dir / route.query)

    def evaluate(self, query: Query, *, services: bool) -> Evaluation:
        def truth_of(queries: int, places: int) -> Truth:
            return Truth.within(queries, places, self.route.tolerance)

        return evaluate(self._map_path, query, truth_of, self._config, services=services)

    def query(self) -> Query:
        return Query(self._query)


@pytest.fixture(scope="module")
def map_path_of(data_dir: Path) -> Iterator[Callable[[str], Path]]:
    """Return the map of a reference, which is built once."""
    with ExitStack() as maps:

        @cache
        def built(reference: str) -> Path:
            frames = str(data_dir / reference)
            return maps.enter_context(map_of(frames, Config(), feature_asked=False))

        yield built


@pytest.fixture(params=ROUTES, ids=lambda route: route.query)
def on_route(
    request: pytest.FixtureRequest, data_dir: Path, map_path_of: Callable[[str], Path]
) -> OnRoute:
    route: Route = request.param
    # A deadline as long as the test: a machine that is busy with others misses none of its own.
    config = Config.model_validate(
        {"fusion": {"deadline_s": 300}, "matching": {"tolerance": route.tolerance}}
    )
    return OnRoute(data_dir, route, map_path_of(route.reference), config)


@pytest.mark.parametrize("reference", sorted({route.reference for route in ROUTES}))
def test_a_real_route_that_is_driven_once_has_no_place_twice(
    map_path_of: Callable[[str], Path], reference: str
) -> None:
    same = open_map(map_path_of(reference)).places.same
    assert same.tolist() == [*range(len(same))]


def test_real_routes_are_recognised_and_one_of_them_through_the_services(
    on_route: OnRoute,
) -> None:
    evaluation = on_route.evaluate(on_route.query(), services=on_route.route == ROUTES[2])
    curve = evaluation.results["filter"].curve
    recall, auc = on_route.route.aligned
    assert curve.recall_at_100_precision >= recall
    assert curve.auc >= auc
    assert curve.auc > evaluation.results["ams"].curve.auc
    claims = evaluation.results["filter"].claims
    assert claims is not None
    assert claims.precision >= 0.99
    smoothed = evaluation.smoothed["filter"][20]
    recall, auc = on_route.route.smoothed
    assert smoothed.curve.recall_at_100_precision >= recall
    assert smoothed.curve.auc >= auc
    assert smoothed.mean_lag <= 8
    assert smoothed.claims is not None
    assert smoothed.claims.precision >= 0.995
    assert smoothed.claims.recall >= 0.9


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: route.query)
def test_so_are_they_at_a_speed_that_varies(data_dir: Path, route: Route) -> None:
    trial = prepare(
        str(data_dir / route.reference),
        Query(str(data_dir / route.query), protocol="speed"),
        partial(options_truth.truth_of, tolerance=route.tolerance, truth=None),
        Config.model_validate({"matching": {"tolerance": route.tolerance}}),
        words=False,
    )

    def curve_of(rule: Rule) -> PrecisionRecall:
        channels, matching = trial.placemap.channels, trial.matching(rule)
        matches = match_channels(channels, trial.descriptors, trial.metres, matching)
        return judge(matches, trial.truth).curve

    curve = curve_of("filter")
    recall, auc = route.speed
    assert curve.recall_at_100_precision >= recall
    assert curve.auc >= auc
    for rule in ("evidence", "ams"):
        assert curve.auc > curve_of(rule).auc


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: route.query)
def test_with_odometry_the_speed_does_not_matter(data_dir: Path, route: Route) -> None:
    trial = prepare(
        str(data_dir / route.reference),
        Query(str(data_dir / route.query), protocol="odometry"),
        partial(options_truth.truth_of, tolerance=route.tolerance, truth=None),
        Config.model_validate({"matching": {"tolerance": route.tolerance}}),
        words=False,
    )
    channels, matching = trial.placemap.channels, trial.matching("filter")
    curve = judge(
        match_channels(channels, trial.descriptors, trial.metres, matching), trial.truth
    ).curve
    assert curve.recall_at_100_precision >= route.odometry[0]
    assert curve.auc >= route.odometry[1]
