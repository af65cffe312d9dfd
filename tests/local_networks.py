"""Networks of local features in ONNX, made up for tests."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

PATCH = 7  # pixels of the side of a descriptor's patch
_BOX = np.ones((1, 1, 5, 5), np.float32) / 25
_SOBEL = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]], np.float32)
_OPSETS = [helper.make_opsetid("", 17)]


def write_corner_network(path: Path) -> None:
    """Write a detector of Harris corners, whose descriptors are the patches around them.

    The input is a grey image of any size. A uniform image has no corner.
    """
    constants = {
        "gradients": np.stack([_SOBEL, _SOBEL.T])[:, None],
        "box": _BOX,
        "patches": np.eye(PATCH**2, dtype=np.float32).reshape(-1, 1, PATCH, PATCH),
        "least": np.array(1e-6, np.float32),
        "first": np.array([0]),
        "second": np.array([1]),
        "x, y": np.array([1, 0]),
        "rows, columns": np.array([0, 1]),
    }
    around = {"kernel_shape": [5, 5], "pads": [2] * 4, "strides": [1, 1]}
    nodes = [
        helper.make_node("Conv", ["image", "box"], ["smooth"], pads=[2] * 4),
        helper.make_node("Conv", ["smooth", "gradients"], ["both"], pads=[1] * 4),
        helper.make_node("Gather", ["both", "first"], ["gx"], axis=1),
        helper.make_node("Gather", ["both", "second"], ["gy"], axis=1),
    ]
    for one, other in (("gx", "gx"), ("gy", "gy"), ("gx", "gy")):
        nodes += [
            helper.make_node("Mul", [one, other], [f"{one} {other}"]),
            helper.make_node("AveragePool", [f"{one} {other}"], [f"mean {one} {other}"], **around),
        ]
    nodes += [
        helper.make_node("Mul", ["mean gx gx", "mean gy gy"], ["product"]),
        helper.make_node("Mul", ["mean gx gy", "mean gx gy"], ["square"]),
        helper.make_node("Sub", ["product", "square"], ["corners"]),
        helper.make_node("MaxPool", ["corners"], ["highest"], **around),
        helper.make_node("Equal", ["corners", "highest"], ["is peak"]),
        helper.make_node("Greater", ["corners", "least"], ["is corner"]),
        helper.make_node("And", ["is peak", "is corner"], ["found"]),
        helper.make_node("Squeeze", ["found", "rows, columns"], ["found in image"]),
        helper.make_node("NonZero", ["found in image"], ["at"]),
        helper.make_node("Transpose", ["at"], ["rows and columns"]),
        helper.make_node("Gather", ["rows and columns", "x, y"], ["keypoints"], axis=1),
        helper.make_node("Squeeze", ["corners", "rows, columns"], ["corners in image"]),
        helper.make_node("GatherND", ["corners in image", "rows and columns"], ["scores"]),
        helper.make_node("Conv", ["smooth", "patches"], ["around"], pads=[PATCH // 2] * 4),
        helper.make_node("ReduceMean", ["around"], ["mean"], axes=[1]),
        helper.make_node("Sub", ["around", "mean"], ["centred"]),
        helper.make_node("Transpose", ["centred"], ["last"], perm=[0, 2, 3, 1]),
        helper.make_node("Squeeze", ["last", "first"], ["in image"]),
        helper.make_node("GatherND", ["in image", "rows and columns"], ["descriptors"]),
    ]
    outputs = [
        helper.make_tensor_value_info("keypoints", TensorProto.INT64, ["n", 2]),
        helper.make_tensor_value_info("scores", TensorProto.FLOAT, ["n"]),
        helper.make_tensor_value_info("descriptors", TensorProto.FLOAT, ["n", PATCH**2]),
    ]
    onnx.save(_model(nodes, ["N", 1, "h", "w"], outputs, constants), path)


def constant_network(
    outputs: Mapping[str, NDArray[Any]],
    image: tuple[object, ...] = (1, 3, "h", "w"),
    *,
    per_brightness: str = "",
) -> NDArray[np.uint8]:
    """Return the file of a network that gives the same outputs for each image of this shape.

    The output that ``per_brightness`` names is divided by the image's largest value.
    """
    nodes = [helper.make_node("ReduceMax", ["image"], ["brightness"], keepdims=0)]
    for name in outputs:
        divided = name == per_brightness
        operator, *more = ("Div", "brightness") if divided else ("Identity",)
        nodes.append(helper.make_node(operator, [f"the {name}", *more], [name]))
    declared = [
        helper.make_tensor_value_info(
            name, helper.np_dtype_to_tensor_dtype(values.dtype), values.shape
        )
        for name, values in outputs.items()
    ]
    constants = {f"the {name}": values for name, values in outputs.items()}
    model = _model(nodes, image, declared, constants)
    return np.frombuffer(model.SerializeToString(), np.uint8)


def _model(
    nodes: list[onnx.NodeProto],
    image: Any,
    outputs: list[onnx.ValueInfoProto],
    constants: Mapping[str, NDArray[Any]],
) -> onnx.ModelProto:
    tensors = [numpy_helper.from_array(values, name) for name, values in constants.items()]
    taken = helper.make_tensor_value_info("image", TensorProto.FLOAT, image)
    graph = helper.make_graph(nodes, "made-up", [taken], outputs, tensors)
    return helper.make_model(graph, opset_imports=_OPSETS, ir_version=8)
