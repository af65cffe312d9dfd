"""``placefield bench`` on the command line, with nothing measured."""

import json
from importlib import import_module

import pytest

from placefield_tools.bench.figure import Figure
from placefield_tools.cli.bench import _MODULES
from placefield_tools.cli.main import main

PARTS = ("match", "features", "build", "chain", "scale", "explore", "soak")


@pytest.fixture(params=PARTS)
def part(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """A part of the benchmarks that measures nothing."""
    name: str = request.param
    figures = [Figure("speedup", 9.5, "how much faster", at_least=8), Figure("lost", 2, "frames")]
    module = import_module(f"placefield_tools.bench.{_MODULES[name]}")
    monkeypatch.setattr(module, f"bench_{name}", lambda **_: figures)
    return name


def bench(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr("sys.argv", ["placefield", "bench", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code


def test_json_is_one_object_of_numbers_on_stdout(
    part: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bench(monkeypatch, part, "--json")
    assert json.loads(capsys.readouterr().out) == {"speedup": 9.5, "lost": 2}


def test_a_table_is_printed_without_it(
    part: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bench(monkeypatch, part)
    out = capsys.readouterr().out
    assert part in out
    for text in ("speedup", "9.5", "≥ 8", "how much faster", "lost"):
        assert text in out
