"""The layout of Foxglove for recordings: what its panels show is in a recording."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from placefield.config import MatchingConfig
from placefield_tools.record.recorder_files import recorder_of

Schemas = dict[str, dict[str, Any]]

SHOWN_BY = {
    "Image": "foxglove.CompressedImage",
    "3D": "foxglove.PoseInFrame",
    "map": "foxglove.LocationFix",
    "Plot": "placefield.Match",
    "StateTransitions": "placefield.Match",
}
"""What each kind of panel takes: the first three as Foxglove documents them."""


@pytest.fixture
def panels(deploy: Path) -> dict[str, Any]:
    panels: dict[str, Any] = json.loads((deploy / "foxglove/recording.json").read_text())
    return panels


@pytest.fixture
def schemas(tmp_path: Path) -> Schemas:
    """The schema of each topic of a recording."""
    path = tmp_path / "drive.mcap"
    with recorder_of(path):
        pass
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return {
        channel.topic: json.loads(summary.schemas[channel.schema_id].data)
        for channel in summary.channels.values()
    }


def texts(value: Any) -> Iterator[str]:
    """Yield all keys and texts of a panel's configuration."""
    if isinstance(value, dict):
        yield from value
        value = list(value.values())
    if isinstance(value, list):
        for one in value:
            yield from texts(one)
    elif isinstance(value, str):
        yield value


def test_every_panel_shows_topics_and_fields_of_a_recording(
    panels: dict[str, Any], schemas: Schemas
) -> None:
    shown = set()
    for name, panel in panels["configById"].items():
        paths = [text for text in texts(panel) if text.startswith("/")]
        assert paths, name
        for path in paths:
            topic, _, field = path.partition(".")
            assert schemas[topic]["title"] == SHOWN_BY[name.partition("!")[0]], path
            assert not field or field in schemas[topic]["properties"], path
            shown.add(topic)
    assert shown == set(schemas)


def test_the_threshold_is_the_default_one(panels: dict[str, Any]) -> None:
    values = [path["value"] for path in panels["configById"]["Plot!certainty"]["paths"]]
    assert [float(value) for value in values if value[0] != "/"] == [MatchingConfig().precision]


def test_every_panel_has_its_place(panels: dict[str, Any]) -> None:
    placed = re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(panels["layout"]))
    assert sorted(placed) == sorted(panels["configById"])
