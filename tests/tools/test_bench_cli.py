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
    monkeypatch.setattr(
        "placefield_tools.bench.machine.with_machine",
        lambda measure: [*measure(), Figure("machine_others", 0.25, "taken by others")],
    )
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
    assert json.loads(capsys.readouterr().out) == {
        "speedup": 9.5,
        "lost": 2,
        "machine_others": 0.25,
    }


def test_a_table_is_printed_without_it(
    part: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bench(monkeypatch, part)
    out = capsys.readouterr().out
    assert part in out
    for text in ("speedup", "9.5", "≥ 8", "how much faster", "lost", "machine_others"):
        assert text in out


def test_a_feature_is_measured_under_its_kind(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured(feature: str) -> list[Figure]:
        return [Figure(f"{feature}_ms", 1.5, "")]

    monkeypatch.setattr("placefield_tools.bench.features.bench_features", measured)
    monkeypatch.setattr("placefield_tools.bench.machine.with_machine", lambda measure: measure())
    bench(monkeypatch, "features", "--feature", "gist+grayscale", "--json")
    assert json.loads(capsys.readouterr().out) == {"gist+grayscale_ms": 1.5}


@pytest.mark.parametrize(
    ("command", "measures"), [("build", "build_cost.bench_build"), ("scale", "scale.bench_scale")]
)
def test_a_benchmark_is_of_so_many_places(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    measures: str,
) -> None:
    def measured(places: int | None) -> list[Figure]:
        return [Figure(f"frame_ms_{places}", 1.5, "")]

    monkeypatch.setattr(f"placefield_tools.bench.{measures}", measured)
    monkeypatch.setattr("placefield_tools.bench.machine.with_machine", lambda measure: measure())
    bench(monkeypatch, command, "--places", "5000", "--json")
    assert json.loads(capsys.readouterr().out) == {"frame_ms_5000": 1.5}


def test_a_malformed_kind_of_feature_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["placefield", "bench", "features", "--feature", "onnx:"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code
    (line,) = capsys.readouterr().err.splitlines()
    assert "features.kind" in line
