"""The report of ``placefield study`` in a browser, and a study that is cut off."""

import os
import signal
import subprocess
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from placefield_tools.cli.main import app
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.study import describing
from placefield_tools.study.paper import channel_count_runs

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PATIENCE_S = 120.0


@pytest.fixture(scope="module", params=["", "paper"])
def report(
    request: pytest.FixtureRequest,
    browser: "Browser",
    reference_dir: Path,
    query_dir: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The report of a study, with the default settings or by a preset."""
    folder = tmp_path_factory.mktemp("report")
    flags = ["--preset", request.param, "--feature", "gist"] if request.param else []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(describing, "WORDS", 100)
        patch.setattr(channel_count_runs, "MOST_COMBINATIONS", 1)
        sources = [str(reference_dir), str(query_dir)]
        command = ["study", *sources, "--channels", "2", "-o", str(folder), *flags]
        ended = CliRunner().invoke(app, command)
    assert ended.exit_code == 0, ended.exception
    return folder / "report.html"


@pytest.mark.parametrize("width", [1440, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_anyone_can_read_the_report_on_any_screen(
    browser: "Browser", report: Path, scheme: str, width: int
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is missing")
    page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    page.goto(report.as_uri())
    violations = axe.Axe().run(page).response["violations"]
    assert [(one["id"], node["html"]) for one in violations for node in one["nodes"]] == []
    assert page.evaluate("document.documentElement.scrollWidth") == width, "only parts scroll"
    drawn = "[...document.images].every(one => one.complete && one.naturalWidth > 0)"
    assert page.evaluate(drawn)
    page.close()


def test_a_study_that_is_cut_off_leaves_no_folder(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    command = [*PLACEFIELD, "study", str(reference_dir), str(query_dir), "-o", "new/folder"]
    with log.open("w") as kept, subprocess.Popen(command, cwd=tmp_path, stderr=kept) as process:
        end = time.monotonic() + PATIENCE_S
        while "building our map" not in log.read_text():
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) != 0
    assert os.listdir(tmp_path) == ["log"]
    assert "Traceback" not in log.read_text()
