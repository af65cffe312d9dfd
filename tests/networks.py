"""Small networks in ONNX, made up for tests."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import tomli_w
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

WIDTH, HEIGHT = 24, 16


def write_network(path: Path, *, channels: int = 3, **declared: Any) -> NDArray[np.float32]:
    """Write a network of one convolution to ``path``, and its TOML beside it.

    It takes ``channels`` × HEIGHT × WIDTH; its outputs are ``maps``, and their means ``gap``.

    Returns:
        The kernels, (4, channels, 3, 3), which slide over the image without padding.
    """
    kernels = np.random.default_rng(3).normal(size=(4, channels, 3, 3)).astype(np.float32)
    graph = helper.make_graph(
        [
            helper.make_node("Conv", ["image", "kernels"], ["maps"]),
            helper.make_node("GlobalAveragePool", ["maps"], ["gap"]),
        ],
        "made-up",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", channels, HEIGHT, WIDTH])],
        [
            helper.make_tensor_value_info("maps", TensorProto.FLOAT, ["N", 4, "h", "w"]),
            helper.make_tensor_value_info("gap", TensorProto.FLOAT, ["N", 4, 1, 1]),
        ],
        [numpy_helper.from_array(kernels, "kernels")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    text = tomli_w.dumps({"width": WIDTH, "height": HEIGHT, "output": "maps", **declared})
    path.with_suffix(".toml").write_text(text)
    return kernels
