"""What is installed, as a doctor sees it."""

import sys
from importlib.metadata import PackageNotFoundError

import onnxruntime
import pytest

from placefield_tools.doctor import installation
from placefield_tools.doctor.finding import Health


def with_versions(monkeypatch: pytest.MonkeyPatch, **versions: str | None) -> None:
    """Let there be other versions of some packages, or none."""
    real = installation.version

    def version(name: str) -> str:
        there = versions.get(name.replace("-", "_"), real(name))
        if there is None:
            raise PackageNotFoundError(name)
        return there

    monkeypatch.setattr(installation, "version", version)


def test_where_all_is_there_nothing_is_wrong() -> None:
    findings = list(installation.installation())
    assert {finding.verdict for finding in findings} == {Health.GOOD}
    assert {"python", "libraries", "extra ros"} <= {finding.subject for finding in findings}


def test_a_library_that_is_too_old_is_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    with_versions(monkeypatch, eclipse_zenoh="1.2.0")
    found = installation.libraries()
    assert found.verdict is Health.BAD
    assert "eclipse-zenoh is 1.2.0, and must be" in found.found


def test_an_extra_that_is_missing_is_a_warning_that_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with_versions(monkeypatch, rosbags=None)
    found = installation.of_extra("ros")
    assert found.verdict is Health.WARNING
    assert found.found == "rosbags is missing"
    assert "pip install 'placefield[ros]'" in found.advice
    assert installation.libraries().verdict is Health.GOOD


def test_what_runs_networks_is_said_and_a_provider_that_is_missing_is_bad(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    found = installation.of_networks("cpu")
    assert found.verdict is Health.GOOD
    assert found.found == "onnxruntime with cpu; networks run on cpu"
    missing = installation.of_networks("openvino")
    assert missing.verdict is Health.BAD
    assert "install onnxruntime-openvino" in missing.advice


def test_networks_are_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    found = installation.of_networks("cpu")
    assert found.verdict is Health.WARNING
    assert "pip install 'placefield[onnx]'" in found.advice
