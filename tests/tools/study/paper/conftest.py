from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from placefield.config import Config
from placefield.loading import load_config
from placefield_tools.cli import options_truth
from placefield_tools.evaluate.query import Query
from placefield_tools.study.paper import channel_count_runs as channel_counts
from placefield_tools.study.paper.paper_results import PaperStudy
from placefield_tools.study.paper.run_paper import run_paper_study
from placefield_tools.study.run_study import prepare
from placefield_tools.study.trial import Trial

TRUTH = partial(options_truth.truth_of, tolerance=3, truth=None)


@pytest.fixture(scope="session")
def preset() -> Config:
    """AMS as published, in two channels; to choose the push would take half of the time."""
    flags = {"preset": "paper", "scales": {"channels": 2}, "metric": {"push": 0.5}}
    return load_config(None, flags)


@pytest.fixture(scope="session")
def paper_trial(few_words: object, reference_dir: Path, query_dir: Path, preset: Config) -> Trial:
    """The small route, driven as it was recorded, as published."""
    return prepare(str(reference_dir), Query(str(query_dir)), TRUTH, preset)


@pytest.fixture(scope="session")
def paper_study(
    few_words: object, reference_dir: Path, query_dir: Path, preset: Config
) -> Iterator[PaperStudy]:
    """The experiments on it, with a few combinations of channels."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(channel_counts, "MOST_COMBINATIONS", 2)
        query = Query(str(query_dir))
        yield run_paper_study(str(reference_dir), query, TRUTH, preset, tolerance=3)
