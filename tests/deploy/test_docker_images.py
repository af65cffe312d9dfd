"""What can be said of the images without an engine that builds them."""

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import check_jsonschema
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROLES = {"router", "featurizer", "describer", "channel", "fuser", "verifier", "replay"}

# Runs our command with the packages of some distributions only.
_WITH_ONLY = """
import sys
hidden = set(sys.argv.pop(1).split(","))
class Hiding:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Hiding())
from placefield_tools.cli.main import main
main()
"""


def pins(file: Path) -> dict[str, str]:
    """Return the version of each distribution in a list and in those that it includes."""
    pinned = {}
    for line in file.read_text().splitlines():
        if line.startswith("-r "):
            pinned |= pins(file.parent / line.removeprefix("-r "))
        elif not line.startswith("#"):
            name, version = line.split("==")
            pinned[name] = version
    return pinned


@pytest.fixture(params=["router.txt", "services.txt"])
def pinned(request: pytest.FixtureRequest, deploy: Path) -> dict[str, str]:
    return pins(deploy / "docker" / request.param)


def stages(dockerfile: str) -> dict[str, str]:
    """Return the text of each stage by its name."""
    found = re.split(r"^FROM \S+ AS (\S+)$", dockerfile, flags=re.MULTILINE)
    return dict(zip(found[1::2], found[2::2], strict=True))


def test_the_linter_has_nothing_to_say(deploy: Path) -> None:
    hadolint = Path(sys.executable).with_name("hadolint")
    linted = subprocess.run(
        [hadolint, deploy / "docker" / "Dockerfile"], capture_output=True, text=True, check=False
    )
    assert linted.returncode == 0, linted.stdout


def test_each_role_has_an_image_that_is_pinned_not_roots_and_says_how_it_is(deploy: Path) -> None:
    text = (deploy / "docker" / "Dockerfile").read_text()
    assert re.search(r"^ARG PYTHON=python:\d+\.\d+\.\d+-slim-bookworm$", text, re.MULTILINE)
    by_name = stages(text)
    assert set(by_name) >= ROLES
    assert "USER 10001:10001" in by_name["base"]
    assert not any("USER" in by_name[name] for name in by_name if name != "base")
    for role in ROLES:
        assert f'ENTRYPOINT ["placefield", "{role}"]' in by_name[role]
        assert "HEALTHCHECK" in by_name[role]
        assert "pip" not in by_name[role]


def test_what_the_images_copy_is_there_and_not_ignored(deploy: Path) -> None:
    root = deploy.parent
    text = (deploy / "docker" / "Dockerfile").read_text()
    ignored = (deploy / "docker" / "Dockerfile.dockerignore").read_text().splitlines()
    kept = [line.removeprefix("!") for line in ignored if line.startswith("!")]
    copied = [
        name
        for line in re.findall(r"^COPY (?!--from)(.+) \S+$", text, re.M)
        for name in line.split()
    ]
    assert copied
    for name in copied:
        assert (root / name).exists()
        assert any(Path(name).match(pattern) for pattern in kept), name


def test_make_builds_and_runs_the_image_of_every_role_and_pushes_none(
    deploy: Path, tmp_path: Path
) -> None:
    called = tmp_path / "called"
    docker = tmp_path / "docker"
    docker.write_text(f'#!/bin/sh\necho "$@" >> {called}\n')
    docker.chmod(0o755)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    make = ["make", "--silent", "images", "BUILD_FLAGS=--cache-from type=gha"]
    subprocess.run(make, cwd=deploy.parent, env=os.environ | {"PATH": path}, check=True)
    lines = called.read_text().splitlines()
    builds = [line for line in lines if line.startswith("buildx build ")]
    assert {re.findall(r"--target (\S+)", line)[0] for line in builds} == ROLES
    assert all(line.endswith(" --load --cache-from type=gha .") for line in builds)
    assert f"--file {deploy.name}/docker/Dockerfile " in builds[0]
    ran = [line.split()[-2] for line in lines if line not in builds]
    assert set(ran) == {f"placefield-{role}" for role in ROLES}
    assert "push" not in called.read_text()


def test_make_says_that_an_image_does_not_run(deploy: Path, tmp_path: Path) -> None:
    docker = tmp_path / "docker"
    docker.write_text('#!/bin/sh\n[ "$1" = buildx ]\n')
    docker.chmod(0o755)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    ended = subprocess.run(
        ["make", "images"],
        cwd=deploy.parent,
        env=os.environ | {"PATH": path},
        capture_output=True,
        check=False,
    )
    assert ended.returncode != 0


def test_the_pins_lack_nothing_that_one_of_them_requires(pinned: dict[str, str]) -> None:
    for name in pinned:
        for text in requires(name) or ():
            required = Requirement(text)
            if required.marker is None or required.marker.evaluate({"extra": ""}):
                assert canonicalize_name(required.name) in pinned, f"{name} requires {text}"


def test_the_pins_are_versions_that_the_project_takes(pinned: dict[str, str], deploy: Path) -> None:
    project = tomllib.loads((deploy.parent / "pyproject.toml").read_text())["project"]
    for required in map(Requirement, project["dependencies"]):
        if required.name in pinned:
            assert pinned[required.name] in required.specifier, required


@pytest.fixture(scope="module")
def installed() -> Mapping[str, list[str]]:
    """The distributions that bring each package."""
    return packages_distributions()


def run_with_only(
    pinned: dict[str, str], installed: Mapping[str, list[str]], *arguments: str
) -> "subprocess.CompletedProcess[str]":
    """Run our command as if nothing but these distributions were installed."""
    own = {*pinned, "placefield"}
    hidden = [
        package
        for package, distributions in installed.items()
        if package.isidentifier()
        and not own & {canonicalize_name(distribution) for distribution in distributions}
    ]
    return subprocess.run(
        [sys.executable, "-c", _WITH_ONLY, ",".join(hidden), *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )


def test_every_role_starts_with_what_is_pinned_for_it(
    deploy: Path,
    installed: Mapping[str, list[str]],
    map_path: Path,
    verified_map_path: Path,
    query_dir: Path,
    endpoint: str,
) -> None:
    at = ("--endpoint", endpoint, "--set", "bus.connect_timeout_s=0.1")
    router, services = (pins(deploy / "docker" / f"{name}.txt") for name in ("router", "services"))
    commands = {
        ("alive",): router,
        ("featurizer", str(map_path)): services,
        ("channel", str(map_path), "--channel", "0"): services,
        ("fuser", str(map_path)): services,
        ("verifier", str(verified_map_path)): services,
        ("replay", str(query_dir)): services,
    }
    for command, pinned in commands.items():
        ended = run_with_only(pinned, installed, *command, *at)
        assert f"placefield: no router at {endpoint}" in ended.stderr, ended.stderr
    ended = run_with_only(router, installed, "router", "--endpoint", "tcp/256.0.0.1:7557")
    assert "placefield: cannot listen at tcp/256.0.0.1:7557" in ended.stderr, ended.stderr


def test_the_compose_file_is_one(deploy: Path) -> None:
    schema = "vendor.compose-spec"
    checked = subprocess.run(
        [
            *(sys.executable, "-m", check_jsonschema.__name__),
            *("--builtin-schema", schema, str(deploy / "docker" / "compose.yaml")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout


def test_the_compose_file_serves_loopback_alone_and_gives_no_service_more_than_it_needs(
    deploy: Path,
) -> None:
    compose = yaml.safe_load((deploy / "docker" / "compose.yaml").read_text())
    services = compose["services"]
    assert {service["build"]["target"] for service in services.values()} == ROLES - {"replay"}
    published = [port for service in services.values() for port in service.get("ports", ())]
    assert published == ["127.0.0.1:7557:7557"]
    for service in services.values():
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert "mem_limit" in service
        assert all(
            volume.endswith(":ro") for volume in service.get("volumes", ()) if "/route" in volume
        )
