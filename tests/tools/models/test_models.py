"""Networks by name: what the registry says, fetching from a server on this machine, exporting."""

import hashlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from networks import HEIGHT, WIDTH, write_network
from typer.testing import CliRunner

from placefield.errors import ConfigError, SourceError
from placefield.features.extract import feature_of
from placefield_tools.cli.main import app
from placefield_tools.models import getting
from placefield_tools.models.getting import feature_named, get
from placefield_tools.models.registry import Model, model, models
from placefield_tools.models.showing import export_script, print_model


def ignore(*_: object) -> None:
    pass


@pytest.fixture
def known(web: Any, tmp_path: Path) -> Model:
    """A network that the server has."""
    write_network(tmp_path / "net.onnx")
    content = (tmp_path / "net.onnx").read_bytes()
    web.content["/net.onnx"] = content
    facts = {
        "name": "net",
        "about": "of tests",
        "code_licence": "MIT",
        "weights_licence": "CC0-1.0",
        "page": "http://127.0.0.1",
        "dimension": 4,
        "input": {"width": WIDTH, "height": HEIGHT, "output": "gap"},
        "url": f"{web.url}/net.onnx",
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    return Model.model_validate(facts)


def test_a_fetched_network_gives_features(known: Model, tmp_path: Path, web: Any) -> None:
    file = get(known, tmp_path / "models", ignore)
    assert file.read_bytes() == web.content["/net.onnx"]
    (part,) = feature_of(f"onnx:{file}").parts
    assert part.network is not None
    assert part.network.input == known.input
    assert not (tmp_path / "models" / "net.partial").exists()
    requests = len(web.ranges)
    assert get(known, tmp_path / "models", ignore) == file
    assert len(web.ranges) == requests


def test_what_was_cut_off_goes_on(known: Model, tmp_path: Path, web: Any) -> None:
    web.cuts = [300]
    file = get(known, tmp_path / "models", ignore)
    assert web.ranges == [None, "bytes=300-"]
    assert hashlib.sha256(file.read_bytes()).hexdigest() == known.sha256


def test_another_file_than_the_known_one_is_removed(known: Model, tmp_path: Path, web: Any) -> None:
    content = bytearray(web.content["/net.onnx"])
    content[-1] ^= 1
    web.content["/net.onnx"] = bytes(content)
    with pytest.raises(SourceError, match="removed, its SHA-256 is"):
        get(known, tmp_path / "models", ignore)
    assert not list((tmp_path / "models").rglob("*.onnx"))


def test_a_name_stands_for_its_fetched_file(
    known: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr(getting, "models", lambda: {"net": known})
    assert feature_named("gist") == "gist"
    with pytest.raises(ConfigError, match="see 'placefield models get net'"):
        feature_named("net")
    file = get(known, getting.models_folder(), ignore)
    assert file.is_relative_to(tmp_path)
    assert feature_named("net") == f"onnx:{file}"


def test_the_commands_say_what_is_known_and_how_to_get_it() -> None:
    runner = CliRunner()
    assert "mobilenetv2" in runner.invoke(app, ["models"]).stdout
    shown = runner.invoke(app, ["models", "show", "mobilenetv2"]).stdout
    known = model("mobilenetv2")
    for fact in (known.sha256, known.url, known.weights_licence, f"{known.bytes} bytes"):
        assert str(fact) in shown
    refused = runner.invoke(app, ["models", "get", "salad"])
    assert "'placefield models show salad' says how" in str(refused.exception)
    assert "unknown model" in str(runner.invoke(app, ["models", "show", "no"]).exception)


@pytest.mark.parametrize("name", [each.name for each in models().values() if each.export])
def test_an_export_runs_the_authors_code_at_the_size_of_the_toml(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    exported: list[tuple[Any, ...]] = []
    outputs: list[object] = []

    class Module:
        def eval(self) -> "Module":
            return self

        def load_state_dict(self, state: object) -> None:
            assert state == "weights"

        def __call__(self, image: object) -> object:
            return (image, "attention")

    torch, code = ModuleType("torch"), ModuleType("main")
    torch.nn, torch.hub, torch.onnx = ModuleType("nn"), ModuleType("hub"), ModuleType("onnx")  # type: ignore[attr-defined]
    torch.nn.Module = Module
    torch.zeros = lambda *shape: shape  # type: ignore[attr-defined]
    torch.load = lambda path: "weights"  # type: ignore[attr-defined]
    torch.hub.load = lambda *_, **__: Module()
    code.VPRModel = lambda **_: Module()  # type: ignore[attr-defined]

    def export(network: Any, image: object, file: str, **more: object) -> None:
        outputs.append(network.forward(image))
        exported.append((image, file, more["output_names"]))

    torch.onnx.export = export
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "main", code)
    known = model(name)
    exec(compile(export_script(known), "export.py", "exec"), {})
    shape = (1, 3, known.input.height, known.input.width)
    assert exported == [(shape, f"{name}.onnx", ["feature"])]
    assert outputs == [shape]
    print_model(known)
    assert export_script(known) in capsys.readouterr().out
