"""The commands that the documentation shows are ours, with options that they have."""

import inspect
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from doc_commands import PROJECT, blocks, pages

from placefield_tools.cli import options
from placefield_tools.cli.main import app

PAGES = [*pages(), PROJECT / "SECURITY.md", PROJECT / "CHANGELOG.md", PROJECT / "deploy/README.md"]
ASSIGNMENT = re.compile(r"[A-Z_]+=.*")
BETWEEN = set("();<>|&")


def commands_in(shell: str) -> Iterator[list[str]]:
    """Yield the words of the ``placefield`` commands in shell, without those before and behind."""
    for line in shell.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        words: list[str] = []
        for word in [*lexer, ";"]:
            if set(word) <= BETWEEN:
                yield from own(words)
                words = []
            elif words or not ASSIGNMENT.fullmatch(word):
                words.append(word)


def own(words: list[str]) -> Iterator[list[str]]:
    if words and Path(words[0]).name == "placefield":
        yield words[1:]


def shown_on(page: Path) -> list[list[str]]:
    shells = [block.text for block in blocks(page) if block.language == "sh"]
    return [words for shell in shells for words in commands_in(shell)]


def parse(words: list[str]) -> None:
    """Parse a command line without running it; what is none of ours raises what Typer has."""
    command: Any = typer.main.get_command(app)
    context = command.make_context("placefield", [*words])
    while hasattr(command, "resolve_command"):
        rest = [*context._protected_args, *context.args]
        name, command, rest = command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)


@pytest.fixture(autouse=True)
def _log_as_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(options, "log_as_json", lambda: None)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_commands_parse(page: Path) -> None:
    for words in shown_on(page):
        try:
            parse(words)
        except Exception as error:
            pytest.fail(f"placefield {shlex.join(words)}: {error!r}")


def test_commands_are_found() -> None:
    shell = "make demo\nA=1 placefield up m.pfmap \\\n  --run x  # y\nbin/placefield a>b && c"
    assert list(commands_in(shell)) == [["up", "m.pfmap", "--run", "x"], ["a"]]
    assert sum(len(shown_on(page)) for page in PAGES) > 50


def commands_of(group: typer.Typer) -> Iterator[typer.models.CommandInfo]:
    yield from group.registered_commands
    for info in group.registered_groups:
        assert info.typer_instance is not None
        yield from commands_of(info.typer_instance)


def test_every_command_shows_an_example_that_parses_but_for_benchmarks() -> None:
    for command in commands_of(app):
        described = inspect.getdoc(command.callback) or ""
        examples = [*commands_in(described.partition("Examples:")[2])]
        is_benchmark = command.callback.__module__.endswith(".bench")  # type: ignore[union-attr]
        assert examples or is_benchmark, command.name
        for words in examples:
            parse(words)


@pytest.mark.parametrize(
    "line",
    ["inspect", "upp m.pfmap", "up m.pfmap --rum x", "plan m.pfmap --cores two", "security ini x"],
)
def test_what_is_no_command_of_ours_is_reported(line: str) -> None:
    with pytest.raises(Exception, match=r".+"):
        parse(line.split())
