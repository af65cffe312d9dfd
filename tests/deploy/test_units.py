"""The systemd units, as systemd reads them."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from placefield_tools.cli.main import app

UNITS = [
    "placefield-host.service",
    "placefield-router.service",
    "placefield-featurizer.service",
    "placefield-describer@0.service",
    "placefield-channel@0.service",
    "placefield-fuser.service",
    "placefield-verifier@0.service",
]
INSTALLED_AT = "/opt/placefield/bin/"


@pytest.fixture(scope="module")
def units(deploy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the units, with the commands of this environment."""
    if shutil.which("systemd-analyze") is None:
        pytest.skip("needs the command 'systemd-analyze'")
    folder = shutil.copytree(deploy / "systemd", tmp_path_factory.mktemp("systemd") / "units")
    for unit in folder.glob("*.service"):
        here = f"{Path(sys.executable).parent}/"
        unit.write_text(unit.read_text().replace(INSTALLED_AT, here))
    return folder


def analyze(units: Path, unit: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        ["systemd-analyze", *arguments, f"./{unit}"],
        cwd=units,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("unit", UNITS)
def test_systemd_has_nothing_to_say_about_a_unit(units: Path, unit: str) -> None:
    verified = analyze(units, unit, "verify")
    complaints = [line for line in verified.stderr.splitlines() if "placefield" in line]
    assert verified.returncode == 0, complaints
    assert not complaints


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_may_do_little(units: Path, unit: str) -> None:
    judged = analyze(units, unit, "security", "--offline=true", "--threshold=20")
    assert judged.returncode == 0, judged.stdout


def test_each_unit_is_watched_and_runs_a_command_that_there_is(deploy: Path) -> None:
    common = (deploy / "systemd" / "placefield-.service.d" / "common.conf").read_text()
    for line in ("Type=notify", "WatchdogSec=20", "Restart=always", "DynamicUser=yes"):
        assert line in common.splitlines()
    files = {re.sub("@.*[.]", "@.", unit) for unit in UNITS}
    assert {file.name for file in (deploy / "systemd").glob("*.service")} == files
    for file in files:
        text = (deploy / "systemd" / file).read_text()
        (command,) = re.findall(f"^ExecStart={INSTALLED_AT}placefield (.+)$", text, re.MULTILINE)
        name, *arguments = command.split()
        helped = CliRunner().invoke(app, [name, "--help"])
        assert helped.exit_code == 0
        flags = [argument for argument in arguments if argument.startswith("--")]
        assert all(flag in helped.stdout for flag in flags)
