"""The wheel: what is installed from it runs with no checkout beside it."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = {
    "placefield": PROJECT / "shared" / "placefield",
    "placefield_services": PROJECT / "services" / "placefield_services",
    "placefield_tools": PROJECT / "tools" / "placefield_tools",
}

RECOGNISE = """
import sys
from pathlib import Path
from placefield import Config, Recognizer, open_map

recognizer = Recognizer(open_map(Path("route.pfmap")), Config(matching={"rule": "ams"}))
for file in sorted(Path(sys.argv[1]).iterdir()):
    print(recognizer.update(file.read_bytes()).place)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder]
    subprocess.run([*command, PROJECT], check=True, capture_output=True)
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel; the libraries that it needs are the ones of this one."""
    folder = tmp_path_factory.mktemp("elsewhere")
    venv.create(folder, with_pip=False)
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    pip = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "install"]
    offline = ["--no-deps", "--no-index", "--no-compile", "--quiet", wheel]
    subprocess.run([*pip, *offline], check=True, capture_output=True)
    return folder / "bin"


def test_it_has_every_file_of_the_packages_and_the_licence(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"{package}/{file.relative_to(folder)}"
        for package, folder in PACKAGES.items()
        for file in folder.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    assert expected <= names
    assert any(name.endswith("LICENSE") for name in names)
    assert not {name for name in names if name.startswith(("tests", "docs", "deploy"))}


def test_a_map_is_built_and_a_drive_recognised_outside_the_checkout(
    installed: Path, reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    def run(program: str, *arguments: str | Path, **settings: str) -> str:
        environment = {"PATH": os.defpath, "OMP_NUM_THREADS": "1", "HOME": str(tmp_path)}
        command = [installed / program, *arguments]
        ended = subprocess.run(
            command,
            cwd=tmp_path,
            env=environment | settings,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    where = run("python", "-c", "import placefield_tools; print(placefield_tools.__file__)")
    assert where.startswith(str(installed.parent))
    flags = "--metric", "identity", "--feature", "grayscale"  # what takes the least compiling
    # Interpreted, the kernels of a build take less time than compiling them.
    run("placefield", "build", reference_dir, "-o", "route.pfmap", *flags, NUMBA_DISABLE_JIT="1")
    (tmp_path / "recognise.py").write_text(RECOGNISE)
    places = run("python", "recognise.py", query_dir).split()
    assert sum(abs(int(place) - frame) <= 3 for frame, place in enumerate(places)) >= 50
