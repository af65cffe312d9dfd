"""After the warm-up nothing is left to compile; each test starts its own process."""

import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from placefield.config import Config
from placefield.maps.build import build_map
from placefield.maps.map_metrics import learned_metric, with_looks
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.maps.traverse import Traverse
from placefield.matching.warm_up import beginning_of

pytestmark = pytest.mark.slow

PLACES, DIMENSIONS = 240, 30

COUNTS_WHAT_IS_COMPILED = """
import gc, sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from numba.core.dispatcher import Dispatcher
from placefield.config import MatchingConfig
from placefield.maps.opening import open_map
from placefield.matching.warm_up import warm_up
from placefield.matching.channel_stage import ChannelStage

def compiled():
    kernels = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {(each.py_func.__qualname__, str(own)) for each in kernels for own in each.signatures}

path, rule, reverse, measured = sys.argv[1:]
matching = MatchingConfig(rule=rule, reverse=bool(reverse))
opened = open_map(Path(path))
travelled = np.arange(float(opened.places.count)) if measured else None
topology = opened.topology if travelled is None else replace(opened.topology, travelled=travelled)
warm_up(opened.channels, matching, topology)
before = compiled()
frames = np.random.default_rng(0).normal(size=(6, len(opened.model.components)))
frames = (frames / np.linalg.norm(frames, axis=1, keepdims=True)).astype(np.float32)
for shards in (1, 2):
    stage = ChannelStage(dict(enumerate(opened.channels)), matching, 0, shards, topology)
    stream = stage.new_stream()
    compared = list(stage.compare(list(frames)))
    drive = [*compared, None, *compared, *(one for each in compared for one in (each, None))]
    for number, observed in enumerate(drive):
        reading = float(number) if number < len(compared) else None
        partials = stream.local(observed, stream.next, reading)
        stream.reduce({number: [one] * shards for number, one in partials.items()})
assert before and compiled() == before, compiled() - before
"""


def traverse() -> Traverse:
    rng = np.random.default_rng(3)
    features = 5 + np.cumsum(rng.normal(size=(PLACES, DIMENSIONS)), axis=0)
    stamps = np.arange(PLACES, dtype=np.int64)
    return Traverse(
        "a walk",
        features.astype(np.float32),
        stamps,
        np.zeros((0, 3)),
        np.empty(0),
        (b"",) * PLACES,
    )


@pytest.fixture(scope="module", params=["one look", "looks", "a circuit"])
def map_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of a channel under a learned metric, and of one with a coarse index."""
    built = build_map(
        [traverse()],
        Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}}),
    )
    first, other = built.channels
    descriptors = (first.metric.unit * first.metric.places).astype(np.float32)
    projection = np.random.default_rng(1).normal(size=(12, descriptors.shape[1]))
    metrics = [
        learned_metric(projection.astype(np.float32), descriptors, coarse=coarse)
        for coarse in (False, True)
    ]
    if request.param == "looks":
        shown = np.arange(150, 220, dtype=np.int32)
        metrics = [with_looks(each, shown, first.metric.places[shown]) for each in metrics]
    channels = [replace(c, metric=m) for c, m in zip((first, other), metrics, strict=True)]
    if request.param == "a circuit":
        built = replace(built, graph=built.graph.with_links([(PLACES - 1, 0)]))
    path = tmp_path_factory.mktemp("warm-up") / "walk.pfmap"
    save_map(replace(built, channels=tuple(channels)), path)
    return path


@pytest.mark.parametrize(
    ("rule", "measured"),
    [("filter", ""), ("filter", "odometry"), ("evidence", ""), ("ams", "")],
)
@pytest.mark.parametrize("reverse", ["", "reverse"])
def test_after_the_warm_up_no_frame_waits_for_the_compiler(
    map_path: Path, rule: str, measured: str, reverse: str
) -> None:
    arguments = [str(map_path), rule, reverse, measured]
    program = [sys.executable, "-c", COUNTS_WHAT_IS_COMPILED, *arguments]
    ended = subprocess.run(program, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


def test_a_beginning_has_the_first_places_and_all_else(map_path: Path) -> None:
    channel = open_map(map_path).channels[1]
    short = beginning_of(channel)
    assert_begins(short, channel)
    assert_begins(short.metric, channel.metric)
    assert channel.metric.coarse is not None
    assert short.metric.coarse is not None
    np.testing.assert_array_equal(short.metric.coarse.codes, channel.metric.coarse.codes[:100])
    np.testing.assert_array_equal(short.metric.coarse.axes, channel.metric.coarse.axes)
    assert np.shares_memory(short.metric.places, channel.metric.places)


def assert_begins(short: object, whole: object) -> None:
    assert isinstance(short, type(whole))
    for field in fields(short):  # type: ignore[arg-type]
        one, other = getattr(short, field.name), getattr(whole, field.name)
        if isinstance(one, np.ndarray):
            cut = tuple(slice(100 if n == PLACES else None) for n in other.shape)
            np.testing.assert_array_equal(one, other[cut])
        elif not hasattr(one, "places") and field.name != "coarse":
            assert one == other
