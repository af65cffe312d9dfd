from functools import partial
from pathlib import Path

import pytest

from placefield.config import Config
from placefield_tools.cli import options_truth
from placefield_tools.evaluate.query import Query
from placefield_tools.study import describing
from placefield_tools.study.run_study import prepare
from placefield_tools.study.trial import Trial

TRUTH = partial(options_truth.truth_of, tolerance=3, truth=None)


def config() -> Config:
    return Config.model_validate({"scales": {"channels": 2}})


@pytest.fixture(scope="session")
def few_words() -> object:
    """A small vocabulary, learned at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(describing, "WORDS", 100)
        yield


@pytest.fixture(scope="session")
def trial(few_words: object, reference_dir: Path, query_dir: Path) -> Trial:
    """The small route, driven as it was recorded."""
    return prepare(str(reference_dir), Query(str(query_dir)), TRUTH, config())


@pytest.fixture(scope="session")
def reverse_trial(few_words: object, reference_dir: Path, query_dir: Path) -> Trial:
    """The small route, driven the other way."""
    query = Query(str(query_dir), protocol="reverse")
    return prepare(str(reference_dir), query, TRUTH, config())
