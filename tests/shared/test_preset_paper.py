"""The preset ``paper`` against AMS written out, see ``reference_ams``, from images to matches."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest
import reference_ams
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from reference_ams import ReferenceMap

from placefield.config import Config
from placefield.features.extract import feature_of
from placefield.fusion.match import SmoothedMatch
from placefield.fusion.rules import fuse
from placefield.library import build_map
from placefield.loading import load_config
from placefield.maps import build
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse
from placefield.matching.candidate import UNANSWERED
from placefield.matching.comparing import Comparison
from placefield.matching.sharding import ChannelShard
from placefield.recognizer import Recognizer
from placefield.scales.channels import Channel
from placefield.scales.encoding import encode

Image = NDArray[np.uint8]

CHANNELS = 3
FRAMES = 64


def images(seed: int, *, night: bool = False) -> list[Image]:
    """Render a camera that pans along one smooth random wall after the other."""
    walls, own = np.random.default_rng(seed), np.random.default_rng([seed, night])
    height, width, step = 48, 64, 4
    rendered: list[Image] = []
    while len(rendered) < FRAMES:
        count = int(walls.integers(3, 11))
        wall = np.zeros((height, width + step * count))
        for grain in (4, 8, 16):
            colours = walls.normal(size=(height // grain + 2, wall.shape[1] // grain + 2))
            size = wall.shape[1], height
            wall += math.sqrt(grain) * cv2.resize(colours, size, interpolation=cv2.INTER_CUBIC)
        for frame in range(count):
            left = step * frame + night
            view = 128 + (18 if night else 25) * wall[:, left : left + width]
            noisy = view + own.normal(scale=4, size=view.shape)
            rendered.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return rendered[:FRAMES]


def positions_of(seed: int) -> list[int]:
    """Return the place of each query frame: now and then the vehicle waits, or skips one."""
    steps = np.random.default_rng([seed, 2]).choice([0, 1, 2], FRAMES - 1, p=[0.15, 0.7, 0.15])
    return np.clip(np.r_[0, np.cumsum(steps)], 0, FRAMES - 1).tolist()


def raw_features(frames: Sequence[Image], kind: str) -> NDArray[np.float64]:
    feature = feature_of(kind)
    return np.array([feature.describe(image) for image in frames], np.float64)


@dataclass(frozen=True)
class PaperDrive:
    """A route by day, its map, and the smoothed matches of a query by night."""

    config: Config
    placemap: Map
    smoothed: list[SmoothedMatch]
    reference: ReferenceMap
    query: NDArray[np.float64]
    places: list[int]

    @property
    def unit(self) -> float:
        """The unit of the map's descriptors; those of the reference have none."""
        return float(self.placemap.model.deviation[0])

    @property
    def blur(self) -> float:
        """By how much the rounding of descriptors may move the square root of a window's score.

        That is a length, and moves by the rounding's part in one direction: in a window of
        whatever length less than a unit of the coarsest metric, as a rule, and hardly two.
        """
        return 2 * max(channel.metric.unit for channel in self.placemap.channels)

    @property
    def signs(self) -> NDArray[np.float64]:
        """Of the map's axes, beside the reference ones: the sign of an axis is arbitrary."""
        return np.sign((self.reference.axes * self.placemap.model.components).sum(axis=1))


def drive_of(kind: str, seed: int, min_scale: int, dimensions: int | None) -> PaperDrive:
    flags: dict[str, Any] = {
        "preset": "paper",
        "seed": seed,
        "features": {"kind": kind},
        "scales": {"channels": CHANNELS, "min_scale": min_scale},
    }
    if dimensions is not None:
        flags["features"]["dimensions"] = dimensions
    config = load_config(None, flags)
    day, query, places = images(seed), images(seed, night=True), positions_of(seed)
    night = [query[place] for place in places]
    placemap = build_map(day, config=config)
    recognizer = Recognizer(placemap, config)
    for image in night:
        recognizer.update(image)
    fuzzifiers = np.linspace(1.02, 1.4, CHANNELS)
    reference = reference_ams.build(
        raw_features(day, kind), dimensions or FRAMES, fuzzifiers, min_scale, seed
    )
    smoothed = recognizer.smoothed() + recognizer.finish()
    return PaperDrive(config, placemap, smoothed, reference, raw_features(night, kind), places)


ROUTES = {
    "all dimensions there are": ("gist", 2, 4, None),
    "shortest segments differ in grey": ("grayscale", 8, 5, 16),
    "shortest segments differ and a channel has one scale": ("gist", 4, 6, 16),
    "a channel has the smallest scale alone": ("grayscale", 4, 5, 16),
}


@pytest.fixture(scope="module", params=ROUTES)
def drive(request: pytest.FixtureRequest) -> PaperDrive:
    drive = drive_of(*ROUTES[request.param])
    scales = [channel.scales.tolist() for channel in drive.placemap.channels]
    name: str = request.param
    assert ("segments differ" in name) == (len({shortest for shortest, *_ in scales}) > 1)
    assert ("one scale" in name) == any(
        len(own) == 1 and own[0] > drive.reference.smallest for own in scales
    )
    assert ("smallest scale alone" in name) == ([drive.reference.smallest] in scales)
    return drive


def test_descriptors_are_by_pca_of_the_features_as_they_are(drive: PaperDrive) -> None:
    model, reference = drive.placemap.model, drive.reference
    np.testing.assert_allclose(model.mean, reference.mean, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(drive.signs[:, None] * model.components, reference.axes, atol=1e-3)
    longest = np.linalg.norm(reference.places, axis=1).max()
    np.testing.assert_allclose(model.deviation, 4 * longest, rtol=1e-5)


def test_every_channel_has_the_labels_and_scales_that_clustering_gives(drive: PaperDrive) -> None:
    assert len(drive.placemap.channels) == CHANNELS
    for channel, reference in zip(drive.placemap.channels, drive.reference.channels, strict=True):
        np.testing.assert_array_equal(channel.labels, reference.labels)
        assert channel.scales.tolist() == reference.scales


def test_the_smallest_scale_is_one_and_set_beforehand(drive: PaperDrive) -> None:
    assert {c.smallest for c in drive.placemap.channels} == {drive.config.scales.min_scale}


def test_the_weight_is_chosen_by_cross_validation(drive: PaperDrive) -> None:
    weight = drive.reference.weight
    assert drive.placemap.metric.push == pytest.approx(weight / (1 + weight))


def test_projections_are_learned_by_equation_8(drive: PaperDrive) -> None:
    for channel, reference in zip(drive.placemap.channels, drive.reference.channels, strict=True):
        v = drive.signs[:, None] * drive.signs * channel.metric.projection
        np.testing.assert_allclose(v, reference.v, atol=2e-5)


def test_every_smoothed_match_is_that_of_the_equations(drive: PaperDrive) -> None:
    exact = reference_ams.match(drive.reference, drive.query)
    rounded = reference_ams.match(drive.reference, drive.query, blur=drive.blur * drive.unit)
    assert [each.frame for each in drive.smoothed] == list(range(FRAMES))
    others, moved = 0, []
    for each, reference, options in zip(drive.smoothed, exact, rounded, strict=True):
        place, score = each.match.place, each.match.score
        if not options:
            assert (place, score) == (UNANSWERED, 0)
            continue
        others += place not in {Y for _, Y in reference}
        by_place = [math.sqrt(F) / drive.unit for F, at in options if at == place]
        assert by_place, f"frame {each.frame}: {place} is not among {options}"
        moved.append(min((math.sqrt(-score) - root for root in by_place), key=abs))
    assert np.abs(moved).max() <= drive.blur
    assert abs(np.mean(moved)) <= drive.blur / 8  # rounding has no side
    assert others <= FRAMES / 20  # where rounding decides


def test_frames_whose_windows_the_query_ends_in_have_no_match(drive: PaperDrive) -> None:
    shortest = min(
        reference_ams.coarse_scales(channel.scales, drive.reference.smallest)[0]
        for channel in drive.reference.channels
    )
    unanswered = [each.frame for each in drive.smoothed if each.match.place == UNANSWERED]
    assert unanswered == list(range(FRAMES - shortest + 1, FRAMES))


def test_a_smoothed_match_comes_with_the_last_frame_of_the_longest_window(
    drive: PaperDrive,
) -> None:
    longest = max(int(channel.scales[-1]) for channel in drive.placemap.channels)
    lags = [min(longest - 1, FRAMES - 1 - frame) for frame in range(FRAMES)]
    assert [each.lag for each in drive.smoothed] == lags


def test_the_route_is_recognised(drive: PaperDrive) -> None:
    pairs = zip(drive.smoothed, drive.places, strict=True)
    assert np.mean([abs(each.match.place - place) <= 3 for each, place in pairs]) > 0.8


# One smallest scale, whatever the segments are.

runs_of_channel = st.lists(st.integers(1, 12), min_size=4, max_size=14)


def map_of(cuts: list[list[int]], min_scale: int, frames: int = 30) -> Map:
    """Make a map of channels whose segments have such lengths, over and over."""
    rng = np.random.default_rng(len(cuts))
    traverse = Traverse(
        "made up",
        rng.normal(size=(frames, 6)).astype(np.float32),
        np.arange(frames, dtype=np.int64),
        np.empty((0, 3)),
        np.empty(0),
        (b"",) * frames,
    )
    config = load_config(
        None,
        {"preset": "paper", "metric": {"kind": "identity"}, "scales": {"min_scale": min_scale}},
    )

    def cut(*_: object) -> tuple[Channel, ...]:
        clusters = [
            np.repeat(np.arange(frames), np.resize(lengths, frames))[:frames] for lengths in cuts
        ]
        return tuple(Channel(1.1, own, encode(own, min_scale)) for own in clusters)

    return build.build_map([traverse], config, cut=cut)


@given(st.lists(runs_of_channel, min_size=1, max_size=4), st.integers(2, 8), st.integers(1, 99))
def test_no_channel_wins_by_comparing_another_number_of_frames(
    cuts: list[list[int]], min_scale: int, apart: int
) -> None:
    placemap = map_of(cuts, min_scale)
    assert [channel.smallest for channel in placemap.channels] == [min_scale] * len(cuts)
    matching = load_config(None, {"preset": "paper"}).matching
    everywhere = np.full(placemap.places.count, apart, np.int32)
    answered = []
    for channel in placemap.channels:
        shard = ChannelShard(channel, matching)
        frame = Comparison(shard.metric, shard.metric.places[0] * 0, everywhere, 0.0)
        matcher = shard.new_matcher()
        smoothed = []
        for _ in range(20):
            answered.append(matcher.update(frame))
            smoothed += matcher.smoothed()
        answered += [each.candidate for each in smoothed]
    score = apart * min_scale * shard.metric.unit**2
    assert {each.score for each in answered if each.place != UNANSWERED} == {score}
    assert fuse(answered, matching).score == -score


def test_no_window_is_cut_however_long() -> None:
    placemap = map_of([[70, 5]], min_scale=4, frames=75)
    recognizer = Recognizer(placemap, load_config(None, {"preset": "paper"}))
    places = placemap.channels[0].metric.places / 4000
    for place in places.astype(np.float32):
        recognizer.update_descriptor(place)
    first, *_ = recognizer.smoothed()
    assert (first.frame, first.match.place, first.match.score, first.lag) == (0, 0, 0, 69)
