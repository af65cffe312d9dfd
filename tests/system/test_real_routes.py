"""Real frames, default settings: what the README's table says, held from below."""

from pathlib import Path

import pytest

from placefield.config import Config
from placefield.evaluation.truth import Truth
from placefield_tools.building import map_of
from placefield_tools.evaluating import evaluate

ROUTES = [
    ("gardens_point/day_left", "gardens_point/day_right", 3, 0.99),
    ("gardens_point/day_right", "gardens_point/night_right", 3, 0.99),
    ("nordland/summer", "nordland/winter", 4, 0.85),
    ("corridor/ref", "corridor/query", 2, 0.70),
]


@pytest.mark.parametrize(("reference", "query", "tolerance", "recall"), ROUTES)
def test_evidence_recognises_real_routes_through_the_services(
    data_dir: Path, reference: str, query: str, tolerance: int, recall: float
) -> None:
    def truth_of(queries: int, places: int) -> Truth:
        return Truth.within(queries, places, tolerance)

    # As long as the test: a machine that is busy with others misses no deadline of its own.
    patient = Config.model_validate({"fusion": {"deadline_s": 300}})
    with map_of(str(data_dir / reference), patient, feature_asked=False) as map_path:
        evaluation = evaluate(map_path, str(data_dir / query), truth_of, patient, services=True)
    evidence = evaluation.results["evidence"].curve
    published = evaluation.results["lowest-score"].curve
    assert evidence.recall_at_100_precision >= recall
    assert evidence.auc > published.auc
