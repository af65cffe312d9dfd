"""Real frames, as a camera with a fisheye lens takes them, on a map of a pinhole camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from lenses import Lens, pinhole

from placefield.config import Config
from placefield.evaluation.truth import Truth
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.build.used_part import AskedPart
from placefield_tools.evaluate.drive_matching import Metres, descriptors_of, match_drive
from placefield_tools.evaluate.judging import judge
from placefield_tools.sources import Parts, open_source

CONFIG = Config.model_validate({"metric": {"kind": "identity"}, "scales": {"channels": 1}})
FOCAL = 300.0  # of the frames, 960 pixels wide, as if they were of 116 degrees
FISHEYE = Lens("fisheye", (0.0, 0.0, 0.0, 0.0), 640, 360, (364.0, 364.0), (319.5, 179.5))


def auc(placemap: Map, query: Path, camera: Path | None = None) -> float:
    """Return the area under the curve of the matches at once."""
    feature = feature_of_model(placemap.model)
    with open_source(str(query), parts=Parts(camera=camera)) as source:
        raws = [feature.of_frame(frame) for frame in source]
    descriptors, metres = descriptors_of(placemap.model, raws), Metres(placemap, [None] * len(raws))
    matches = match_drive(placemap.channels, descriptors, metres, CONFIG.matching)
    return judge(matches.causal, Truth.within(len(raws), placemap.places.count, 3)).curve.auc


@pytest.mark.slow
def test_a_fisheye_query_is_recognised_as_well_as_one_without_distortion(
    data_dir: Path, tmp_path: Path
) -> None:
    day, night = (data_dir / "gardens_point" / name for name in ("day_left", "night_right"))
    straight = pinhole(960, 540, FOCAL).write(tmp_path / "straight.yaml")
    fisheye = FISHEYE.write(tmp_path / "fisheye.yaml")
    bent = tmp_path / "bent"
    bent.mkdir()
    for file in sorted(night.glob("*.jpg")):
        pixels = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        assert pixels is not None
        focal = FOCAL * pixels.shape[1] / 960
        cv2.imwrite(str(bent / file.name), FISHEYE.retaken(np.asarray(pixels, np.uint8), focal))
    images = AskedPart(query_cameras=[fisheye])
    common = build_from([str(day)], CONFIG, parts=Parts(camera=straight), images=images)
    rectified = auc(common, bent, fisheye)
    assert rectified == pytest.approx(auc(common, night, straight), abs=0.01)
    assert auc(build_from([str(day)], CONFIG), bent) < rectified - 0.03
