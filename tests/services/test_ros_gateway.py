"""Settings that the gateway refuses before it connects."""

import threading
from pathlib import Path

import pytest

from placefield.config import Config
from placefield.errors import ConfigError
from placefield_services.map_versions import MapVersions
from placefield_services.ros_gateway import Topics, run_ros


@pytest.mark.parametrize(
    ("settings", "topics", "complaint"),
    [
        ({"runs": ["a", "b"]}, Topics(0, "/camera"), "runs a, b"),
        ({"runs": ["12"]}, Topics(0, "/camera"), "run '12'"),
        ({}, Topics(0, "camera/*"), r"topic 'camera/\*'"),
        ({}, Topics(0, "/camera", "odom"), "topic 'odom'"),
        ({}, Topics(0, "/camera", spacing_m=0.5), "--spacing: needs odometry"),
        ({"bus": {"credentials": "x"}}, Topics(0, "/camera"), "credentials"),
    ],
)
def test_settings_that_ros_cannot_use_are_refused(
    map_path: Path, settings: dict[str, object], topics: Topics, complaint: str
) -> None:
    with pytest.raises(ConfigError, match=complaint):
        run_ros(MapVersions(map_path), topics, Config.model_validate(settings), threading.Event())
