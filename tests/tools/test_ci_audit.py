import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

AUDIT = Path(__file__).parents[2] / ".ci" / "audit"
SOUND = {"name": "numpy", "version": "2.0", "vulns": []}
VULNERABLE = {"name": "old", "version": "1.0", "vulns": [{"id": "CVE-1"}, {"id": "CVE-2"}]}
UNKNOWN = {"name": "own", "skip_reason": "not found on PyPI"}


def audit(report: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, AUDIT], input=report, capture_output=True, text=True, check=False
    )


def test_a_known_vulnerability_fails_and_is_named() -> None:
    ended = audit(json.dumps({"dependencies": [SOUND, VULNERABLE, UNKNOWN]}))
    assert ended.returncode == 1
    assert ended.stderr == "old 1.0: CVE-1, CVE-2\n"


def test_no_known_vulnerability_passes_and_says_how_many_were_audited() -> None:
    ended = audit(json.dumps({"dependencies": [SOUND, SOUND, UNKNOWN]}))
    assert ended.returncode == 0
    assert ended.stdout.startswith("2 packages audited, 0 vulnerable; 1 unknown")


@pytest.mark.parametrize("report", [None, {"dependencies": [UNKNOWN]}])
def test_offline_nothing_is_said_to_be_audited(report: Any) -> None:
    ended = audit(json.dumps(report) if report else "")
    assert ended.returncode == 0
    assert ended.stdout.startswith("dependencies not audited:")
    assert ended.stdout.count("\n") == 1
