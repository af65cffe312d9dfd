"""Opening a network in onnxruntime, whose wheel is an extra."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from placefield.config import InferenceConfig, Provider
from placefield.errors import ConfigError
from placefield.features.onnx_file import check_onnx

if TYPE_CHECKING:
    import onnxruntime

_PROVIDERS: dict[Provider, str] = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
_WHEELS: dict[Provider, str] = {
    "cpu": "onnxruntime",
    "cuda": "onnxruntime-gpu",
    "openvino": "onnxruntime-openvino",
    "coreml": "onnxruntime on macOS",
}
_PREFIX = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ")
_SILENT = 4  # errors come as exceptions, and are not logged besides


def open_session(
    name: str, onnx: NDArray[np.uint8], inference: InferenceConfig
) -> onnxruntime.InferenceSession:
    """Open a network; no file is read besides these bytes.

    Args:
        name: of the network, used in messages.
        onnx: (bytes,) its file.
        inference: the provider, and the number of threads on the CPU.

    Raises:
        ConfigError: the file is refused (see ``check_onnx``), onnxruntime cannot run the network,
            or onnxruntime or the provider is missing.
    """
    check_onnx(name, onnx)
    if inference.provider not in available_providers():
        raise ConfigError(missing_provider(inference.provider))
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = inference.threads
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = _SILENT
    options.add_session_config_entry("session.load_model_format", "ONNX")
    wanted = _PROVIDERS[inference.provider]
    try:  # what the provider has not, the CPU runs
        session = onnxruntime.InferenceSession(
            onnx.tobytes(), options, providers=list(dict.fromkeys([wanted, _PROVIDERS["cpu"]]))
        )
    except Exception as error:  # its exceptions have no common class
        raise ConfigError(
            f"{name}: no network that onnxruntime can run: {reason_of(error)}"
        ) from None
    if wanted not in session.get_providers():
        raise ConfigError(
            f"setting inference.provider: {inference.provider} does not start on this machine; "
            "are its device and its driver there?"
        )
    return session


def available_providers() -> list[Provider]:
    """Return the providers of the installed onnxruntime.

    Raises:
        ConfigError: onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError:
        raise ConfigError(
            "a network needs onnxruntime, which is not installed: pip install 'placefield[onnx]'"
        ) from None
    there = onnxruntime.get_available_providers()
    return [provider for provider, name in _PROVIDERS.items() if name in there]


def missing_provider(provider: Provider) -> str:
    """Return the line about a provider that the installed onnxruntime does not have."""
    return (
        f"setting inference.provider: {provider} is not available here; install "
        f"{_WHEELS[provider]} in place of the present onnxruntime"
    )


def reason_of(error: Exception) -> str:
    """Return onnxruntime's reason in one line, without its prefix."""
    return (_PREFIX.sub("", str(error)) or repr(error)).splitlines()[0]
