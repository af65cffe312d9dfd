"""A network of two routes by day, and drives at dusk that pass its junction or turn off there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from side_street import JUNCTION, make_junction

from placefield.config import Config
from placefield.evaluation.protocols import kidnap
from placefield.features.descriptor_stage import DescriptorStage
from placefield.features.extract import feature_of
from placefield.features.fitting import fit_descriptors
from placefield.features.frames import Frame
from placefield.maps.build import build_map
from placefield.maps.joining_routes import join_routes
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse, describe_frame, traverse_of
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.revisits import same_places
from placefield.recognizer import Recognizer
from placefield_tools.demo.light import Image

pytestmark = pytest.mark.slow

Raws = NDArray[np.float32]
Numbers = NDArray[np.int64]

CONFIG = Config.model_validate({"metric": {"kind": "identity"}})
FRAMES = 60
JOINS = 6  # the frame with which the route into the side street begins
NEAR = 3

_NUMBERS, _SHARED = np.arange(FRAMES), JUNCTION - 1
ON_STREET = np.stack([_NUMBERS, np.zeros(FRAMES, np.int64)], axis=1)
INTO_SIDE_STREET = np.stack(
    [np.minimum(_NUMBERS, _SHARED), np.maximum(_NUMBERS - _SHARED, 0)], axis=1
)
PLACES = np.concatenate([ON_STREET, INTO_SIDE_STREET[JOINS:]])
"""Positions of frames and places: spacings along the street, and into the side street."""


class Drives(NamedTuple):
    street: Traverse
    side_street: Traverse
    passes: Raws
    turns_off: Raws


def described(name: str, images: Sequence[Image]) -> Traverse:
    feature = feature_of("gist")
    frames = (Frame(at, at, "", image) for at, image in enumerate(images))
    return traverse_of(name, [describe_frame(frame, feature) for frame in frames])


@pytest.fixture(scope="module")
def drives() -> Drives:
    day, dusk = make_junction("day"), make_junction("dusk")
    return Drives(
        described("street", day.drive(FRAMES, 1, turns=False)),
        described("side street", day.drive(FRAMES, 2, turns=True)[JOINS:]),
        described("passes", dusk.drive(FRAMES, 3, turns=False)).raw,
        described("turns off", dusk.drive(FRAMES, 4, turns=True)).raw,
    )


@pytest.fixture(scope="module")
def network(drives: Drives) -> Map:
    return build_map([join_routes([drives.street, drives.side_street])], CONFIG)


def known_and_right(
    placemap: Map, raws: Raws, shown: Numbers, places: Numbers
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which matches are known, and which are right, given the positions of frames and places.

    The distance of two positions is the way along the streets.
    """
    recognizer = Recognizer(placemap)
    matches = [recognizer.update_raw(raw) for raw in raws]
    matched = places[[match.place for match in matches]]
    return np.array([match.known for match in matches]), np.abs(matched - shown).sum(axis=1) <= NEAR


def frames_until(flags: NDArray[np.bool_]) -> int:
    return int(flags.argmax()) if flags.any() else len(flags)


@pytest.fixture(scope="module")
def after_a_jump(drives: Drives) -> float:
    """Median frames until a jump on the street is known and right, without a side street."""
    street, frames = build_map([drives.street], CONFIG), []
    for seed in range(16):
        legs = kidnap(FRAMES, seed)
        raws = drives.passes[legs.frames]
        known, right = known_and_right(street, raws, ON_STREET[legs.frames], ON_STREET)
        frames += [frames_until(leg) for leg in np.split(known & right, legs.jumps)[1:]]
    return float(np.median(frames))


def belief_in_streets(placemap: Map, raws: Sequence[Raws | None]) -> list[float]:
    """Return the belief, after the last frame, in both streets behind the junction."""
    stage = ChannelStage(
        dict(enumerate(placemap.channels)), CONFIG.matching, topology=placemap.topology
    )
    stream, images = stage.new_stream(), DescriptorStage(placemap.model).new_stream()
    for raw in raws:
        descriptor = None if raw is None else images.update_raw(raw)
        compared = None if descriptor is None else next(stage.compare([descriptor]))
        candidate = stream.update(compared)[0]
    behind = PLACES[candidate.places] > [_SHARED, 0]
    return [float(candidate.evidence[on].sum()) for on in behind.T]


def test_routes_that_part_at_a_junction_are_linked_by_their_pictures(network: Map) -> None:
    """To a place: in the first frame of the turn, the streets still look alike."""
    off = FRAMES + JUNCTION - JOINS
    links = [[JOINS - 1, FRAMES], [JUNCTION - 1, off], [off - 1, JUNCTION]]
    assert network.graph.links.shape == (3, 2)
    assert np.abs(network.graph.links - links).max() <= 1


@pytest.mark.parametrize("first", [0, 8, 14])
def test_a_shared_stretch_ends_where_the_streets_part_however_short_it_is(
    drives: Drives, first: int
) -> None:
    raws = [drives.street.raw, drives.side_street.raw[first:]]
    _, described = fit_descriptors(raws, "gist", dimensions=300, standardise=True, routes=2)
    same = same_places(np.concatenate(described), np.array([0, FRAMES], np.int32))
    twins, numbers = np.split(same, [FRAMES])[1], np.arange(len(same))[FRAMES:]
    assert np.flatnonzero(twins != numbers).tolist() == [*range(JUNCTION - JOINS - first)]


@pytest.mark.parametrize(("drive", "way"), [("passes", 0), ("turns_off", 1)])
def test_both_ways_are_believed_until_a_picture_tells(
    network: Map, drives: Drives, drive: str, way: int
) -> None:
    raws: Raws = getattr(drives, drive)
    unobserved: list[Raws | None] = [*raws[:JUNCTION], None, None, None]
    assert min(belief_in_streets(network, unobserved)) > 0.4
    assert belief_in_streets(network, [*unobserved, raws[len(unobserved)]])[way] > 0.9


@pytest.mark.parametrize(
    ("drive", "shown"), [("passes", ON_STREET), ("turns_off", INTO_SIDE_STREET)]
)
def test_behind_a_junction_the_way_is_known_as_soon_as_a_place_after_a_jump(
    network: Map, drives: Drives, after_a_jump: float, drive: str, shown: Numbers
) -> None:
    known, right = known_and_right(network, getattr(drives, drive), shown, PLACES)
    assert right[known].all()

    assert frames_until((known & right)[JUNCTION:]) <= after_a_jump
