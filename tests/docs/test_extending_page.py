"""The package on the page about extending brings what the page says."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doc_commands import PROJECT, blocks

from placefield import Recognizer, SourceError, build_map
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.loading import load_config
from placefield.maps.digest import NO_DIGEST
from placefield_tools.record.recorder_files import recorder_of
from placefield_tools.sources import open_source


@pytest.fixture
def myparts(install: Callable[..., Path]) -> None:
    page = list(blocks(PROJECT / "docs" / "extending.md"))
    (about,) = [tomllib.loads(block.text)["project"] for block in page if block.language == "toml"]
    python = [block.text for block in page if block.language == "python"]
    code = "\n".join(text for text in python if "def test_" not in text)
    groups = about["entry-points"]
    assert set(groups) == {
        "placefield.features",
        "placefield.sources",
        "placefield.recorders",
    }
    install(about["name"], code, groups)


@pytest.mark.usefixtures("myparts")
def test_its_feature_recognises_what_its_source_gives(query_dir: Path, tmp_path: Path) -> None:
    with open_source(str(query_dir)) as folder:
        np.save(tmp_path / "drive.npy", np.stack([frame.pixels() for frame in folder]))
    config = load_config(None, {"features": {"kind": "edges"}, "scales": {"channels": 1}})
    with open_source(f"numpy:{tmp_path / 'drive.npy'}") as source:
        frames = list(source)
    recognizer = Recognizer(build_map(frames, config=config), config)
    places = [recognizer.update(frame.image).place for frame in frames]
    assert np.mean(np.abs(np.subtract(places, range(len(places)))) <= 3) > 0.9
    with pytest.raises(SourceError, match=r"nothing\.npy: cannot be read"):
        open_source("numpy:nothing.npy")


@pytest.mark.usefixtures("myparts")
def test_its_own_test_passes() -> None:
    page = blocks(PROJECT / "docs" / "extending.md")
    (own,) = [block.text for block in page if "def test_" in block.text]
    names: dict[str, Any] = {}
    exec(compile(own, "test_edges.py", "exec"), names)
    names["test_edges_is_a_feature"]()


@pytest.mark.usefixtures("myparts")
def test_its_recorder_writes_known_places(tmp_path: Path) -> None:
    path, header = tmp_path / "drive.places", Header(stream="one", sequence=0, stamp_ns=0)
    with recorder_of(path) as recorder:
        for place, known in ((3, True), (4, False), (5, True)):
            match = MatchMessage(map=NO_DIGEST, place=place, score=1.0, known=known)
            recorder.write_match(header, match)
        recorder.write_match(header.model_copy(update={"end": True}), None)
    assert path.read_text() == "3\n5\n"
