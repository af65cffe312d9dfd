"""Real drives across junctions: the vehicle is known at least as soon as after a jump."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from traverse_parts import part

from placefield.config import Config
from placefield.evaluation.protocols import kidnap
from placefield.features.extract import feature_of
from placefield.features.frames import Frame
from placefield.fusion.match import Match
from placefield.maps.build import build_map
from placefield.maps.joining_routes import join_routes
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse, describe_frame, traverse_of
from placefield.recognizer import Recognizer

pytestmark = pytest.mark.slow

CONFIG = Config.model_validate({"metric": {"kind": "identity"}})
CUTS = {"A": slice(0, 90), "B": slice(60, 150), "C": slice(120, 200)}
NEAR = 3


def described(folder: Path) -> Traverse:
    feature = feature_of("gist")
    images = [file.read_bytes() for file in sorted(folder.iterdir())]
    frames = (Frame(at, at, "", image) for at, image in enumerate(images))
    return traverse_of(folder.name, [describe_frame(frame, feature) for frame in frames])


def matched(placemap: Map, raws: NDArray[np.float32]) -> list[Match]:
    recognizer = Recognizer(placemap)
    return [recognizer.update_raw(raw) for raw in raws]


def known_right(
    matches: list[Match], shown: NDArray[np.int64], frame_of: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which matches are known and right; ``frame_of`` is the frame that each place shows."""
    return np.array(
        [
            bool(match.known) and abs(int(frame_of[match.place]) - int(frame)) <= NEAR
            for match, frame in zip(matches, shown, strict=True)
        ]
    )


def frames_until(flags: NDArray[np.bool_], starts: list[int]) -> list[int]:
    legs = np.split(flags, starts)[1:]
    return [int(leg.argmax()) if leg.any() else len(leg) for leg in legs]


def test_behind_a_junction_a_vehicle_is_known_as_soon_as_after_a_jump(data_dir: Path) -> None:
    day, query = (
        described(data_dir / "gardens_point" / name) for name in ("day_left", "day_right")
    )
    network = build_map([join_routes([part(day, name, cut) for name, cut in CUTS.items()])], CONFIG)
    assert network.graph.links.tolist() == [[59, 90], [89, 120], [149, 180], [179, 210]]
    frame_of = np.concatenate([np.arange(cut.start, cut.stop) for cut in CUTS.values()])
    frames = np.arange(len(query.raw))
    matches = matched(network, query.raw)
    at_junctions = frames_until(known_right(matches, frames, frame_of), [90, 150])
    assert all(
        abs(frame_of[match.place] - at) <= NEAR for at, match in enumerate(matches) if match.known
    )

    whole, after_jumps = build_map([day], CONFIG), []
    for seed in range(8):
        drive = kidnap(len(query.raw), seed)
        flags = known_right(matched(whole, query.raw[drive.frames]), drive.frames, frames)
        after_jumps += frames_until(flags, drive.jumps.tolist())
    assert np.median(at_junctions) <= np.median(after_jumps)
