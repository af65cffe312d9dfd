from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from sklearn.preprocessing import normalize, scale
from threadpoolctl import threadpool_limits

from placefield.config import Config, MetricConfig
from placefield.errors import MapError
from placefield.maps.build import build_map
from placefield.maps.build_steps import Steps
from placefield.maps.map import Map
from placefield.maps.traverse import Alignment, Traverse

MakeTraverse = Callable[..., Traverse]


def config_of(metric: str = "identity", **scales: Any) -> Config:
    return Config.model_validate({"metric": {"kind": metric}, "scales": {"channels": 2, **scales}})


def refusal(traverses: list[Traverse], config: Config) -> str:
    with pytest.raises(MapError) as refused:
        build_map(traverses, config)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_places_are_the_frames_of_the_first_traverse(make_traverse: MakeTraverse) -> None:
    first = make_traverse(name="day", spacing=0.5)
    built = build_map([first, make_traverse(name="night", noise=1)], config_of())
    assert [(record.name, record.frames) for record in built.traverses] == [
        ("day", 90),
        ("night", 90),
    ]
    assert built.places.count == 90
    np.testing.assert_array_equal(built.places.stamps, first.stamps)
    assert built.pose_frame == "route"
    assert built.places.pose(3) == (1.5, 0, 0)
    for place in (0, 1, 89):
        assert built.places.thumbnail(place) == first.thumbnails[place]
    standardised = scale(normalize(first.raw.astype(np.float64)))
    descriptors = normalize(standardised @ built.model.components.T.astype(np.float64))
    for channel in built.channels:
        places = channel.metric.unit * channel.metric.places
        np.testing.assert_allclose(places, descriptors, atol=3e-4)


def test_without_poses_places_have_none(small_map: Map) -> None:
    assert small_map.pose_frame is None
    assert small_map.places.pose(3) is None


def test_the_number_of_dimensions_is_recorded_as_it_was_used(make_traverse: MakeTraverse) -> None:
    config = config_of()
    for asked, used in ((None, 300), (7, 7)):
        features = config.features.model_copy(update={"dimensions": asked})
        asked_for = config.model_copy(update={"features": features})
        built = build_map([make_traverse()], asked_for)
        assert built.features.dimensions == used
    assert built.model.components.shape == (7, 30)


def test_under_the_identity_a_channels_places_are_the_descriptors(small_map: Map) -> None:
    one, other = (channel.metric for channel in small_map.channels)
    assert one is other
    np.testing.assert_array_equal(one.projection, np.eye(30))
    np.testing.assert_allclose(np.linalg.norm(one.unit * one.places, axis=1), 1, atol=1e-3)
    assert not one.learned
    assert small_map.channels[0].curve.shape == (0, 2)


def test_a_channel_is_described_by_its_segments(small_map: Map) -> None:
    for channel in small_map.channels:
        labels = np.zeros(90, int)
        for number, (first, end) in enumerate(channel.segments, start=1):
            labels[first:end] = number
        np.testing.assert_array_equal(channel.labels, labels)
        assert channel.scales.tolist() == sorted(set(np.diff(channel.segments)[:, 0].tolist()))
        assert channel.scales[0] >= 4


def weathered(seed: int, frames: int = 200) -> Traverse:
    """A route in weather of its own: 12 dimensions depend on the place, 18 on the traverse."""
    place = gaussian_filter1d(np.random.default_rng(0).normal(size=(frames, 12)), 2, axis=0)
    rng = np.random.default_rng(seed)
    raw = np.hstack([place / place.std(), rng.normal(size=(frames, 18))])
    raw += 0.1 * rng.normal(size=raw.shape)
    stamps = np.arange(frames, dtype=np.int64)
    return Traverse(
        "weathered", raw.astype(np.float32), stamps, np.empty((0, 3)), np.empty(0), (b"",) * frames
    )


@pytest.mark.parametrize("kind", ["lmnn", "rca"])
def test_a_learned_metric_projects_the_places(kind: str) -> None:
    traverses = [weathered(seed=1), weathered(seed=2)]
    plain = build_map(traverses, config_of())
    learned = build_map(traverses, config_of(kind))
    assert any(channel.metric.learned for channel in learned.channels)
    for channel, unprojected in zip(learned.channels, plain.channels, strict=True):
        metric, identity = channel.metric, unprojected.metric
        assert metric.learned == (not np.array_equal(metric.projection, np.eye(30)))
        expected = identity.unit * identity.places @ metric.projection.T
        np.testing.assert_allclose(metric.unit * metric.places, expected, atol=1e-3)
        assert len(channel.curve) > 1


@pytest.mark.parametrize("kind", ["lmnn", "rca", "lfda", "nca"])
def test_of_one_traverse_no_metric_is_learned(make_traverse: MakeTraverse, kind: str) -> None:
    built = build_map([make_traverse()], config_of(kind))
    for channel in built.channels:
        assert not channel.metric.learned
        assert channel.curve.shape == (0, 2)


def test_without_the_gate_a_metric_is_learned_of_one_traverse_too() -> None:
    config = config_of("lmnn")
    ungated = config.model_copy(update={"metric": MetricConfig(kind="lmnn", gate=False)})
    built = build_map([weathered(seed=1)], ungated)
    assert all(channel.metric.learned for channel in built.channels)


def test_progress_reports_of_every_long_step() -> None:
    reported: dict[tuple[int | None, str], list[float]] = {}

    def progress(number: int | None, what: str, share: float) -> None:
        reported.setdefault((number, what), []).append(share)

    steps = Steps(progress=progress)
    build_map([weathered(seed=1), weathered(seed=2)], config_of("lmnn"), steps=steps)
    of_channels = {(n, what) for n in (0, 1) for what in ("clustering", "learning")}
    of_all = {"fitting descriptors", "estimating clusters", "finding revisited places"}
    assert set(reported) == of_channels | {(None, what) for what in of_all}
    for step, shares in reported.items():
        assert len(shares) > (5 if step in of_channels else 1)
        assert shares == sorted(shares)
        assert shares[-1] == 1


def test_what_progress_raises_ends_the_build() -> None:
    def stop(number: int | None, what: str, share: float) -> None:
        if share > 0.1:
            raise InterruptedError

    traverses = [weathered(seed=1), weathered(seed=2)]
    with pytest.raises(InterruptedError):
        build_map(traverses, config_of("lmnn"), steps=Steps(progress=stop))


def as_bytes(built: Map) -> list[bytes]:
    return [
        array.tobytes()
        for channel in built.channels
        for array in (channel.metric.projection, channel.metric.places, channel.labels)
    ]


@pytest.mark.parametrize("workers", [2, 5])
def test_on_how_many_threads_the_channels_are_made_changes_no_bit(workers: int) -> None:
    traverses, config = [weathered(seed=1), weathered(seed=2)], config_of("lmnn", channels=5)
    with threadpool_limits(1), ThreadPoolExecutor(workers) as pool:
        one = build_map(traverses, config)
        other = build_map(traverses, config, steps=Steps(pool.map))
    assert any(channel.metric.learned for channel in one.channels)
    assert as_bytes(one) == as_bytes(other)


def test_traverses_of_other_lengths_are_refused_by_their_names(
    make_traverse: MakeTraverse,
) -> None:
    traverses = [make_traverse(90, name="day"), make_traverse(80, name="night")]
    message = refusal(traverses, config_of())
    assert "night has 80 frames and day 90, and they are not aligned" in message


def aligned(traverse: Traverse, frames: list[int], left_out: int) -> Traverse:
    """Return the frames of these numbers, aligned, then ``left_out`` frames that show no place."""
    places = np.array(frames + [-1] * left_out, np.int32)
    others = np.random.default_rng(5).normal(size=(left_out, traverse.raw.shape[1]))
    raw = np.concatenate([traverse.raw[frames], 50 * others]).astype(np.float32)
    alignment = Alignment(places, np.ones(len(places), np.float32), "smoother")
    return replace(traverse, raw=raw, alignment=alignment)


def test_a_metric_learns_from_aligned_frames_whatever_their_order_and_from_no_others() -> None:
    day, night = weathered(seed=1), weathered(seed=2)
    frames = list(range(200))
    shuffled = np.random.default_rng(3).permutation(frames).tolist()
    plain = build_map([day, night], config_of("lmnn"))
    other = build_map([day, aligned(night, frames, left_out=7)], config_of("lmnn"))
    assert any(channel.metric.learned for channel in plain.channels)
    assert as_bytes(plain) == as_bytes(other)
    in_other_order = build_map([day, aligned(night, shuffled, left_out=7)], config_of("lmnn"))
    for one, same in zip(plain.channels, in_other_order.channels, strict=True):
        assert one.metric.learned == same.metric.learned
        np.testing.assert_allclose(np.abs(one.curve), np.abs(same.curve), rtol=0.05, atol=0.05)


def test_a_metric_is_learned_from_a_traverse_of_another_length() -> None:
    some = [frame for frame in range(10, 190) if frame % 3]
    stopped = [*some[:50], *([some[50]] * 40), *some[51:]]
    built = build_map(
        [weathered(seed=1), aligned(weathered(seed=2), stopped, left_out=4)], config_of("lmnn")
    )
    assert any(channel.metric.learned for channel in built.channels)
    first, second = built.traverses
    assert (first.frames, first.aligned, first.by) == (200, None, None)
    assert (second.frames, second.aligned, second.by) == (
        len(stopped) + 4,
        len(stopped),
        "smoother",
    )


def test_a_stop_has_no_more_weight_than_one_frame() -> None:
    day, night = weathered(seed=1), weathered(seed=2)
    some = list(range(10, 190))
    drive = aligned(night, some, left_out=0)
    assert drive.alignment is not None
    again = [*some[:50], *([some[50]] * 40), *some[51:]]
    stopped = aligned(night, again, left_out=0)
    one, other = (build_map([day, each], config_of("lmnn")) for each in (drive, stopped))
    assert as_bytes(one) == as_bytes(other)


def test_a_smallest_scale_in_metres_holds_for_the_segments(make_traverse: MakeTraverse) -> None:
    built = build_map([make_traverse(spacing=0.1)], config_of(min_scale_metres=1))
    for channel in built.channels:
        assert channel.scales[0] >= 10


def test_a_smallest_scale_in_metres_needs_poses(make_traverse: MakeTraverse) -> None:
    message = refusal([make_traverse(name="day")], config_of(min_scale_metres=3.5))
    assert "--min-scale 3.5m: day has no poses" in message


@pytest.mark.parametrize("frames", [1, 2, 6])
def test_a_reference_too_short_for_the_channels_is_refused(
    make_traverse: MakeTraverse, frames: int
) -> None:
    short = make_traverse()
    short = Traverse(
        short.name,
        short.raw[:frames],
        short.stamps[:frames],
        short.poses,
        short.travelled,
        short.thumbnails[:frames],
    )
    assert f"reference of {frames} frames is too short" in refusal([short], config_of())
