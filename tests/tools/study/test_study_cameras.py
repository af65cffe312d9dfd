"""A study of frames of two cameras: every method gets what both see."""

from pathlib import Path

import numpy as np
import pytest
from lenses import BENT, STRAIGHT, Lens

from placefield.baselines.seqslam import seqslam_image
from placefield.config import Config
from placefield.errors import ConfigError
from placefield.evaluation.truth import Truth
from placefield.features.calibration import View
from placefield.features.extract import feature_of
from placefield.features.images import decode, grey
from placefield.features.rectification import rectify, view_of
from placefield_tools.evaluate.query import Query
from placefield_tools.sources import Parts
from placefield_tools.study.run_study import prepare

CONFIG = Config.model_validate({"scales": {"channels": 1}, "metric": {"kind": "identity"}})


def within_3(queries: int, references: int, every: int) -> Truth:
    return Truth.within(queries, references, 3, every)


def rectified(file: Path, lens: Lens, view: View) -> np.ndarray:
    return rectify(decode(file.read_bytes()), lens.calibration, view)


@pytest.mark.usefixtures("few_words")
@pytest.mark.parametrize("protocol", ["aligned", "reverse"])
def test_every_method_gets_the_frames_rectified_to_the_view_of_both_cameras(
    reference_dir: Path, bent_dir: Path, cameras: tuple[Path, Path], protocol: str
) -> None:
    straight, bent = cameras
    query = Query(str(bent_dir), protocol=protocol, parts=Parts(camera=straight), camera=bent)
    trial = prepare(str(reference_dir), query, within_3, CONFIG)
    view = view_of(STRAIGHT.calibration).common(view_of(BENT.calibration))
    assert trial.placemap.model.view == view
    order = slice(None, None, -1 if protocol == "reverse" else 1)
    for described, folder, lens, step in (
        (trial.reference, reference_dir, STRAIGHT, slice(None)),
        (trial.query, bent_dir, BENT, order),
    ):
        files = sorted(folder.iterdir())[step]
        for number in (0, 31):
            pixels = rectified(files[number], lens, view)
            assert np.array_equal(described.raws[number], feature_of("gist").describe(pixels))
            assert np.array_equal(described.images[number], seqslam_image(grey(pixels)))
        assert described.words.any()


def test_a_study_of_the_querys_camera_alone_is_refused(
    reference_dir: Path, bent_dir: Path, cameras: tuple[Path, Path]
) -> None:
    query = Query(str(bent_dir), camera=cameras[1])
    with pytest.raises(ConfigError, match=r"^--query-camera: .*; give --camera$"):
        prepare(str(reference_dir), query, within_3, CONFIG)
