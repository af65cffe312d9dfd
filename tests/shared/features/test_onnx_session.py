import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from networks import write_network

from placefield.config import InferenceConfig
from placefield.errors import ConfigError
from placefield.features.onnx_session import available_providers, open_session


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_network(tmp_path / "net.onnx")
    return tmp_path / "net.onnx"


def refusal(file: Path, inference: InferenceConfig) -> str:
    with pytest.raises(ConfigError) as refused:
        open_session("net", np.fromfile(file, np.uint8), inference)
    assert len(str(refused.value).splitlines()) == 1
    return str(refused.value)


def test_the_cpu_runs_a_network_in_one_thread_by_default(file: Path) -> None:
    session = open_session("net", np.fromfile(file, np.uint8), InferenceConfig())
    assert session.get_providers() == ["CPUExecutionProvider"]
    options = session.get_session_options()
    assert (options.intra_op_num_threads, options.inter_op_num_threads) == (1, 1)
    assert "cpu" in available_providers()


def test_a_provider_that_is_missing_is_named_with_the_package_that_has_it(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    reason = refusal(file, InferenceConfig(provider="cuda"))
    assert reason.startswith("setting inference.provider: cuda is not available here; install ")
    assert "onnxruntime-gpu" in reason


def test_a_provider_that_does_not_start_is_not_silently_replaced(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = onnxruntime.InferenceSession
    both = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: both)

    def on_the_cpu(onnx: bytes, options: object, providers: list[str]) -> object:
        assert providers == both
        return real(onnx, options, providers=["CPUExecutionProvider"])

    monkeypatch.setattr(onnxruntime, "InferenceSession", on_the_cpu)
    assert "cuda does not start" in refusal(file, InferenceConfig(provider="cuda"))


def test_without_onnxruntime_a_network_is_refused_with_what_to_install(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert "pip install 'placefield[onnx]'" in refusal(file, InferenceConfig())


def test_only_onnx_is_loaded_not_the_runtimes_own_format(file: Path, tmp_path: Path) -> None:
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "net.ort")
    options.add_session_config_entry("session.save_model_format", "ORT")
    onnxruntime.InferenceSession(str(file), options)
    assert "can run" in refusal(tmp_path / "net.ort", InferenceConfig())
