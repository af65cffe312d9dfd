"""The shell completes commands and options."""

import subprocess
import sys
from pathlib import Path

PLACEFIELD = Path(sys.executable).with_name("placefield")


def completed(words: str, position: int) -> list[str]:
    """Ask as bash does when the tab key is pressed."""
    asking = {"_PLACEFIELD_COMPLETE": "complete_bash", "COMP_WORDS": words}
    asked = subprocess.run(
        [PLACEFIELD],
        env=asking | {"COMP_CWORD": str(position)},
        capture_output=True,
        text=True,
        check=True,
    )
    return asked.stdout.split()


def test_commands_are_completed() -> None:
    assert completed("placefield re", 1) == ["replay", "record"]


def test_options_of_a_command_are_completed() -> None:
    assert completed("placefield up --me", 2) == ["--metrics-port"]
