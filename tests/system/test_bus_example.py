"""The programs on the page about the bus, with our client and without, are answered."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from hosting import PATIENCE_S, Host, environment

PAGE = Path(__file__).resolve().parents[2] / "docs" / "bus.md"


EXAMPLES = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES, ids=["with our client", "without"])
def test_the_example_gets_a_match_for_each_of_its_frames(
    host: Host, query_dir: Path, tmp_path: Path, example: str
) -> None:
    script = tmp_path / "example.py"
    script.write_text(example)
    frames = sorted(query_dir.iterdir())[:10]
    with host.listener() as listener:
        ran = subprocess.run(
            [sys.executable, script, host.endpoint, *frames],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            env=environment(),
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        answers = listener.answers()
    assert ran.stdout.splitlines() == [
        f"{frame} {match.place} {match.probability}"
        for frame, (_, match) in zip(frames, answers, strict=True)
    ]
