"""The map of an explored drive has the places of the explorer."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from laps import FRAMES, images_of_laps
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.features.extract import feature_of
from placefield.features.images import small_jpeg
from placefield.maps.drive_file import Drive, DriveFile, DriveFrame
from placefield.maps.map import Map
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.explore.explored_map import AskedMap, build_explored, places_of

CONFIG = Config.model_validate({"scales": {"channels": 2}})
IMAGES = images_of_laps()


@cache  # not on import: each worker of pytest would wait for the compiler
def features() -> list[NDArray[np.float32]]:
    """Return the raw features of the images."""
    return [feature_of("gist").describe(image) for image in IMAGES]


def frames(
    raws: Sequence[NDArray[np.float32] | None], metres: Sequence[float | None] | None = None
) -> list[DriveFrame]:
    return [
        DriveFrame(
            2 * number,
            10 * number,
            metres[number] if metres else None,
            raw,
            small_jpeg(IMAGES[number % FRAMES], 160),
        )
        for number, raw in enumerate(raws)
    ]


def built(path: Path, drive: Sequence[DriveFrame]) -> Map:
    file = DriveFile(path, Drive("s", False, "0" * 16))
    for frame in drive:
        file.append(frame)
    file.close()
    return build_explored(path, AskedMap(path.with_name("laps.pfmap"), CONFIG))


def test_the_map_is_that_of_the_same_images_in_a_folder(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    folder = tmp_path / "laps"
    folder.mkdir()
    for number, image in enumerate(IMAGES):
        cv2.imwrite(str(folder / f"{number:04}.png"), image)
    of_folder = build_from([str(folder)], CONFIG)
    placemap = built(tmp_path / "drive", frames(features()))
    assert placemap.places.count == FRAMES
    for one, other in zip(placemap.channels, of_folder.channels, strict=True):
        assert np.array_equal(one.labels, other.labels)
        assert np.array_equal(one.metric.places, other.metric.places)
    assert np.array_equal(placemap.places.same, of_folder.places.same)
    assert (placemap.places.same[90:] < 70).all()


def test_frames_that_show_nothing_new_are_no_places(tmp_path: Path) -> None:
    raws: list[NDArray[np.float32] | None] = [
        *features()[:60],
        *[features()[59]] * 50,
        None,
        *features()[60:],
    ]
    assert places_of(frames(raws)) == [2 * number for number in [*range(60), *range(111, 191)]]
    placemap = built(tmp_path / "drive", frames(raws))
    assert placemap.places.stamps[60] == 1110


def test_the_metres_are_those_of_the_odometer_unless_it_was_reset(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    metres = [0.5 * number + 3 for number in range(FRAMES)]
    placemap = built(tmp_path / "drive", frames(features(), metres))
    assert placemap.places.travelled[-1] == pytest.approx(0.5 * (FRAMES - 1))
    reset = [*metres[:70], *metres[:70]]
    assert not len(built(tmp_path / "again", frames(features(), reset)).places.travelled)
    assert "odometer was reset" in caplog.text


@pytest.mark.parametrize("count", [0, 1, 10])
def test_a_drive_with_too_little_in_it_has_no_map(tmp_path: Path, count: int) -> None:
    with pytest.raises(MapError, match="change too little"):
        built(tmp_path / "drive", frames(features()[:count]))
