"""What a forge and its visitors read of this project: it is valid, and agrees with the rest."""

import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def check(schema: str, *files: Path) -> None:
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *files]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.parametrize(
    ("schema", "files"),
    [
        ("vendor.github-workflows", WORKFLOWS),
        ("vendor.github-issue-forms", FORMS),
        ("vendor.citation-file-format", [ROOT / "CITATION.cff"]),
    ],
)
def test_a_file_is_as_its_schema_has_it(schema: str, files: list[Path]) -> None:
    assert files
    check(schema, *files)


def test_no_folder_of_tests_has_a_name_that_pytest_leaves_out(pytestconfig: pytest.Config) -> None:
    tests = ROOT / "tests"
    left_out: list[str] = pytestconfig.getini("norecursedirs")
    folders = {file.relative_to(tests).parent for file in tests.rglob("test_*.py")}
    names = {name for folder in folders for name in folder.parts}
    assert not [name for name in names for pattern in left_out if fnmatch(name, pattern)]


def test_workflows_run_nothing_but_targets_of_make() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for file in WORKFLOWS:
        jobs = yaml.safe_load(file.read_text())["jobs"].values()
        commands = [step["run"] for job in jobs for step in job["steps"] if "run" in step]
        assert commands, file
        assert {command.removeprefix("make ") for command in commands} <= targets


def test_every_python_that_is_tested_is_one_that_we_say_we_run_on() -> None:
    (ci,) = WORKFLOWS
    tested = yaml.safe_load(ci.read_text())["jobs"]["test"]["strategy"]["matrix"]["python"]
    assert PROJECT["requires-python"] == f">={tested[0]}"


def test_the_version_is_the_same_everywhere() -> None:
    version = PROJECT["version"]
    newest = re.search(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert newest[1] == version
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version
    assert f"placefield-{version}-py3-none-any.whl" in (ROOT / "README.md").read_text()
