"""The commands that a page shows, and a sandbox to run them in."""

import re
import shlex
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from hosting import PLACEFIELD, Process, environment, wait_until

from placefield_tools.common.host_process import free_endpoint

PROJECT = Path(__file__).resolve().parents[2]

_BLOCK = re.compile(
    r"(?P<note><!-- not run: [^>]*-->\n+)?^```(?P<language>\w+)[^\n]*\n(?P<text>.*?)^```",
    re.M | re.S,
)
_READY = {
    "up": "ready: ",
    "record": "recording ",
    "dashboard": "http://",
    "router": "ready: ",
    "listen": "",
    "serve": "",
}
"""Commands that go on until they are stopped, and what they print when they are ready."""

_ELSEWHERE = ("make", "pip")
"""What CI runs anyway, or a reader has run already."""


@dataclass(frozen=True)
class Block:
    """A block of code in a page."""

    language: str
    text: str
    is_run: bool


def blocks(page: Path) -> list[Block]:
    """Return the blocks of a page; one behind ``<!-- not run: why -->`` is not run."""
    return [
        Block(found["language"], found["text"], found["note"] is None)
        for found in _BLOCK.finditer(page.read_text())
    ]


def commands(text: str) -> list[list[str]]:
    """Return the words of each command in a block of shell."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


class Sandbox:
    """A folder and a bus in which the commands of a page are run, in their order."""

    def __init__(self, folder: Path, logs: Path) -> None:
        self.folder, self.logs = folder, logs
        self.environment = environment(PLACEFIELD_BUS__ENDPOINT=free_endpoint())
        self._stack = ExitStack()
        self._going: list[tuple[list[str], Process]] = []

    def __enter__(self) -> Self:
        self._stack.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if error == (None, None, None):
            for words, going in reversed(self._going):
                assert going.stop() == 0, words
        self._stack.__exit__(None, None, None)

    def run(self, block: Block) -> None:
        """Run all commands of a block."""
        for words in commands(block.text):
            if words[0] == "placefield":
                self._command(words[1:])
            else:
                assert words[0] in _ELSEWHERE, f"not run by anyone: {words}"

    def run_python(self, program: str, python: str) -> None:
        """Run a program in the folder."""
        self._finish([python, "-c", program])

    def _command(self, words: list[str]) -> None:
        ready = _READY.get(words[0])
        if ready is None:
            self._finish([*PLACEFIELD, *words])
            return
        if words[0] == "dashboard":
            words = [*words, "--port", free_endpoint().rpartition(":")[2]]
        process = Process(self.logs, *words, cwd=self.folder, env=self.environment)
        going = self._stack.enter_context(process)
        self._going.append((words, going))
        wait_until(lambda: ready in going.out or not going.runs, f"{words} is ready")
        assert going.runs, going.err

    def _finish(self, command: list[str]) -> None:
        ended = subprocess.run(
            command,
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert ended.returncode == 0, f"{command}: {ended.stdout}\n{ended.stderr}"


def pages() -> Iterator[Path]:
    """Yield the README and the pages of the documentation."""
    yield PROJECT / "README.md"
    yield from sorted((PROJECT / "docs").rglob("*.md"))
