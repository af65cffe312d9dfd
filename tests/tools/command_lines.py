"""Command lines that are run in the process of the tests, and what they leave."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from placefield.loading import ENV_PREFIX
from placefield_tools.cli.main import main


@dataclass(frozen=True)
class Ended:
    """What a command left."""

    code: object
    out: str
    err: str

    @property
    def refusal(self) -> str:
        """The one line that says why the command could not go on."""
        assert self.code == 1, self
        assert not self.out
        lines = [line for line in self.err.splitlines() if line.startswith("placefield: ")]
        assert len(lines) == 1, self.err
        assert self.err.rstrip().endswith(lines[0]), self.err
        return lines[0]


Run = Callable[..., Ended]


def runner(folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs a command line in a folder, without settings of the machine."""
    monkeypatch.chdir(folder)
    for name in [name for name in os.environ if name.startswith(ENV_PREFIX)]:
        monkeypatch.delenv(name)

    def run(*arguments: str | Path) -> Ended:
        monkeypatch.setattr("sys.argv", ["placefield", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return Ended(ended.value.code or 0, *capfd.readouterr())

    return run
