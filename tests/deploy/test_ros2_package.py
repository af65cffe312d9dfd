"""The package for ROS 2, which is not here: it names the commands and topics that there are."""

import json
import re
import shlex
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml
from typer.main import get_command

from placefield_services.ros_gateway import NAMESPACE
from placefield_tools.cli.main import app

PACKAGE = Path("deploy/ros2/placefield_launch")
LAUNCH = PACKAGE / "launch/placefield.launch.xml"
TOPICS = {f"{NAMESPACE}/default/pose", f"{NAMESPACE}/default/smoothed_pose"}


def command(**given: str) -> list[str]:
    """The services' command of the launch file, as ROS makes it of the arguments."""
    root = ET.parse(LAUNCH).getroot()
    arguments = {one.get("name"): one.get("default") for one in root.iter("arg")} | given
    [executable] = root.iter("executable")
    line = re.sub(
        r"\$\(var (\w+)\)", lambda found: arguments[found[1]] or "", executable.get("cmd", "")
    )
    return shlex.split(line)


@pytest.mark.parametrize("options", ["", "--ros-odometry /odom --ros-spacing 0.5"])
def test_the_launched_command_is_one_that_placefield_takes(tmp_path: Path, options: str) -> None:
    program, *words = command(map=str(tmp_path / "a.pfmap"), options=options)
    assert program == "placefield"
    [name, *arguments] = words
    parsed = get_command(app).commands[name].make_context(name, arguments)  # type: ignore[attr-defined]
    assert parsed.params["ros"] == "/camera/image_raw/compressed"
    assert (parsed.params["ros_odometry"] == "/odom") == bool(options)


def test_the_package_is_complete() -> None:
    manifest = ET.parse(PACKAGE / "package.xml").getroot()
    name = manifest.findtext("name")
    assert name == PACKAGE.name
    assert f"project({name} " in (PACKAGE / "CMakeLists.txt").read_text()
    version = re.search(r'^version = "(.+)"', Path("pyproject.toml").read_text(), re.M)
    assert version is not None
    assert manifest.findtext("version") == version[1]
    shown = re.search(r"find-pkg-share (\w+)\)/(\S+)\"", LAUNCH.read_text())
    assert shown is not None
    assert shown[1] == name
    assert (PACKAGE / shown[2]).is_file()


def test_rviz_and_foxglove_show_the_topics_of_the_gateway() -> None:
    rviz = yaml.safe_load((PACKAGE / "config/placefield.rviz").read_text())
    displays = rviz["Visualization Manager"]["Displays"]
    of_poses = {one["Topic"]["Value"] for one in displays if "PoseWith" in one["Class"]}
    assert of_poses == TOPICS
    layout = json.loads((PACKAGE / "config/placefield-foxglove.json").read_text())
    panels = layout["configById"]
    assert set(panels["3D!poses"]["topics"]) == TOPICS
    assert panels["DiagnosticSummary!services"]["topicToRender"] == "/diagnostics"
    assert set(re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout["layout"]))) == set(
        panels
    )
