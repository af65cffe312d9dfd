"""Building maps: the metric beside metric-learn's, and the command with its time and memory."""

import os
import tempfile
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from placefield.config import Config
from placefield.maps.build import build_map
from placefield.maps.build_steps import Steps
from placefield.maps.traverse import Traverse
from placefield.metric.lmnn import LmnnFit, fit_lmnn, objective, target_neighbours
from placefield_tools.bench.described_build import described_build
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.ratio import Ratio
from placefield_tools.bench.street_frames import street_frames
from placefield_tools.bench.timing import Timings, repeat
from placefield_tools.bench.watched_command import Watched, peak_mb_of, watched
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.common.parallel import cores, map_in_order

_FRAMES = 1261  # of the paper's longest route
_CHANNELS = 8
_NEIGHBOURS, _PUSH = 3, 0.5
_METRIC_LEARN_STEPS = 48  # steps of metric-learn: its max_iter is 50
_DEFAULT_RATE = 1e-7  # its default rate, with which it hardly moves in so many steps
_LONG_RATE = 1e-3  # the rate that gets lowest: metric-learn halves it until the objective falls
_STEPS = 30  # steps in which ours must get as low
_LIMIT_S = 120.0  # of a comparison of ways that take many seconds
_LARGE = 6000  # frames whose features are much larger than the libraries

Array = NDArray[np.float32]


def bench_build(places: int | None = None) -> list[Figure]:
    """Measure the build; takes about ten minutes.

    Args:
        places: measure only the build of so many described places.
    """
    if places is not None:
        return described_build(places)
    return [*_command_figures(), *_memory_figures(), *_lmnn_figures()]


def _command_figures() -> list[Figure]:
    with tempfile.TemporaryDirectory(prefix="placefield-bench-") as name:
        folder = Path(name)
        one = _write_frames(folder / "day", shift=0)
        two = [*one, *_write_frames(folder / "other", shift=8)]
        first = _build(one)
        on_all: list[Watched] = []

        def in_turn() -> tuple[float, float]:
            on_all.append(_build(two))
            return _on_one_core(lambda: _build(two)).seconds, on_all[-1].seconds

        alone_s, all_s = repeat(in_turn, [(0, 1)], limit_s=_LIMIT_S).T
    speed_up, peak_mb = Ratio.of(alone_s, all_s), max(build.peak_mb for build in on_all)
    return [
        Figure("build_s", first.seconds, f"{_FRAMES} frames, {_CHANNELS} channels", at_most=60),
        Figure("build_peak_mb", first.peak_mb, "the same: peak memory of the process"),
        Figure(
            "build_learning_s", float(np.median(all_s)), "of two traverses, with LMNN", at_most=60
        ),
        Figure("build_learning_peak_mb", peak_mb, "the same: peak memory of the process"),
        Figure("build_cores_speedup", speed_up, f"the same, {cores()} cores over one"),
    ]


def _write_frames(folder: Path, *, shift: int) -> list[str]:
    folder.mkdir()
    for number, frame in enumerate(street_frames(_FRAMES, size=(320, 240), shift=shift)):
        (folder / f"{number:05}.jpg").write_bytes(frame)
    return [str(folder)]


def _build(references: Sequence[str]) -> Watched:
    """Run the command and watch its memory; the map is not kept."""
    with tempfile.TemporaryDirectory(prefix="placefield-bench-") as folder:
        flags = ["-o", f"{folder}/route.pfmap", "--feature", "gist", "--channels", str(_CHANNELS)]
        return watched([*PLACEFIELD, "build", *references, *flags])


def _on_one_core(build: Callable[[], Watched]) -> Watched:
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        return build()
    finally:
        os.sched_setaffinity(0, allowed)


def _memory_figures() -> list[Figure]:
    def measured(traverses: int, channels: int) -> float:
        # a process that has done nothing yet
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(_memory_ratio, traverses, channels).result()

    what = "peak memory of building over features and descriptors, with LMNN"
    of_two, at_once = "the same of two traverses", "the same, two channels at once"
    return [
        Figure("build_memory_ratio", measured(1, 1), what, at_most=3),
        Figure("build_learning_memory_ratio", measured(2, 1), of_two, at_most=3),
        Figure("build_parallel_memory_ratio", measured(2, 2), at_once),
    ]


def _memory_ratio(traverses: int, channels: int) -> float:
    """Memory that a build of made-up features takes, theirs too, over theirs and descriptors'."""
    walk, rng = _walk(_LARGE, 512), np.random.default_rng(1)
    raws = [
        walk + rng.normal(scale=0.01, size=walk.shape).astype(np.float32) for _ in range(traverses)
    ]
    with threadpool_limits(1):
        # All libraries are loaded, and all kernels compiled.
        _learn([raw[:100] for raw in raws], channels, clusters=4)
        before = peak_mb_of(os.getpid())
        dimensions = _learn(raws, channels, clusters=_LARGE // 30)
    added = 1e6 * (peak_mb_of(os.getpid()) - before)
    features = sum(raw.nbytes for raw in raws)
    return float((features + added) / (features + 4 * _LARGE * traverses * dimensions))


def _learn(raws: Sequence[Array], channels: int, *, clusters: int) -> int:
    """Build a map with LMNN and return the number of dimensions of its descriptors."""
    traverses = [
        Traverse(
            "made-up", raw, np.arange(len(raw)), np.empty((0, 3)), np.empty(0), (b"",) * len(raw)
        )
        for raw in raws
    ]
    scales = {"channels": channels, "clusters": clusters}
    config = {"scales": scales, "metric": {"gate": len(raws) > 1, "steps": 2}}
    placemap = build_map(traverses, Config.model_validate(config), steps=Steps(map_in_order))
    return placemap.model.dimensions


def _lmnn_figures() -> list[Figure]:
    points, labels = _labelled_route()
    fit = _fit(points, labels, _STEPS)
    return [
        *_beside_metric_learn(fit, points, labels, _DEFAULT_RATE, "", at_least=20),
        *_beside_metric_learn(fit, points, labels, _LONG_RATE, "_long_steps"),
    ]


def _beside_metric_learn(
    fit: LmnnFit,
    points: Array,
    labels: NDArray[np.intp],
    rate: float,
    suffix: str,
    at_least: float | None = None,
) -> list[Figure]:
    """Time ours to the objective that metric-learn gets to from this learning rate."""
    plain = _metric_learn(points, labels, rate)
    targets = target_neighbours(points, labels, _NEIGHBOURS)
    goal = objective(plain, points.astype(np.float64), labels, targets, _PUSH)[0]
    steps = int(np.argmax(fit.objective <= goal)) if fit.objective[-1] <= goal else _STEPS
    times = Timings.of(
        [lambda: _metric_learn(points, labels, rate), lambda: _fit(points, labels, steps)],
        compared=[(0, 1)],
        limit_s=_LIMIT_S,
    )
    speedup, reached = times.ratio(0, 1), fit.objective[steps] / goal
    learned, gain = f"metric-learn at rate {rate:g}", goal / fit.objective[0]
    return [
        Figure(f"lmnn{suffix}_speedup", speedup, f"{learned} over ours", at_least=at_least),
        Figure(f"lmnn{suffix}_objective_ratio", reached, f"ours over {learned}", at_most=1),
        Figure(f"lmnn{suffix}_s", times.median(1), f"ours, {steps} steps of {points.shape}"),
        Figure(
            f"metric_learn{suffix}_s",
            times.median(0),
            f"{learned}, {_METRIC_LEARN_STEPS} steps",
        ),
        Figure(f"metric_learn{suffix}_gain", gain, f"objective of {learned} over the start's"),
    ]


def _fit(points: Array, labels: NDArray[np.intp], steps: int) -> LmnnFit:
    return fit_lmnn(points, labels, neighbours=_NEIGHBOURS, push=_PUSH, steps=steps)


def _metric_learn(points: Array, labels: NDArray[np.intp], rate: float) -> NDArray[np.float64]:
    from metric_learn import LMNN

    learner = LMNN(
        init="identity",
        n_neighbors=_NEIGHBOURS,
        regularization=1 - _PUSH,
        max_iter=_METRIC_LEARN_STEPS + 2,
        learn_rate=rate,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(learner.fit(points, labels).components_)


def _labelled_route() -> tuple[Array, NDArray[np.intp]]:
    """1200 x 500 in 48 segments; two thirds of the frames are inactive and share a label.

    Neighbours are 0.3 apart, so that the margin of 1 reaches some ten frames far.
    """
    points = _walk(1200, 500)
    points *= np.float32(0.3) / np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    number, within = np.divmod(np.arange(1200), 25)
    return points, np.where(within < 8, 1 + number, 0)


def _walk(frames: int, dimensions: int) -> Array:
    """Frames that change gradually: a random walk, (frames, dimensions), of variance 1 in all."""
    walk = np.cumsum(np.random.default_rng(0).normal(size=(frames, dimensions)), axis=0)
    walk -= walk.mean(axis=0)
    scale = np.sqrt((walk**2).sum(axis=1).mean())
    return np.asarray(walk / scale, np.float32)
