"""Networks that were made to do harm: refused in one line, by a process that lives on."""

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
import pytest
from networks import HEIGHT, WIDTH, write_network
from numpy.typing import NDArray
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, helper, numpy_helper

from placefield.errors import ConfigError
from placefield.features import network_sandbox
from placefield.features.extract import feature_of
from placefield.features.network import Network, NetworkInput
from placefield.features.network_sandbox import try_network
from placefield.features.onnx_file import MOST_NODES, check_onnx

EXTERNAL = TensorProto.EXTERNAL


def tensor(name: str, values: object, dtype: type = np.int64) -> TensorProto:
    return numpy_helper.from_array(np.array(values, dtype), name)


def model_of(nodes: list[NodeProto], tensors: list[TensorProto]) -> ModelProto:
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 3, HEIGHT, WIDTH])
    feature = helper.make_tensor_value_info("feature", TensorProto.FLOAT, ["a", "b", "c", "d"])
    graph = helper.make_graph(nodes, "made-up", [image], [feature], tensors)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def network_of(model: ModelProto) -> Network:
    onnx_file = np.frombuffer(model.SerializeToString(), np.uint8)
    return Network(NetworkInput(width=WIDTH, height=HEIGHT), onnx_file)


def refusal(network: Network) -> str:
    with pytest.raises(ConfigError) as refused:
        try_network("net", network)
    assert str(refused.value).startswith("net: ")
    assert len(str(refused.value).splitlines()) == 1
    return str(refused.value)


def relu(source: str, result: str) -> NodeProto:
    return helper.make_node("Relu", [source], [result])


def elsewhere(location: str) -> TensorProto:
    """Return a tensor whose data lies in another file."""
    data = TensorProto(name="weight", dims=[1, 3, HEIGHT, WIDTH], data_type=TensorProto.FLOAT)
    data.data_location = EXTERNAL
    data.external_data.add(key="location", value=location)
    return data


def graph_with(data: TensorProto) -> GraphProto:
    return helper.make_graph([relu("a", "b")], "inner", [], [], [data])


def in_the_graph(data: TensorProto) -> ModelProto:
    return model_of([helper.make_node("Add", ["image", "weight"], ["feature"])], [data])


def in_a_constant(data: TensorProto) -> ModelProto:
    constant = helper.make_node("Constant", [], ["weight"], value=data)
    add = helper.make_node("Add", ["image", "weight"], ["feature"])
    return model_of([constant, add], [])


def in_a_list(data: TensorProto) -> ModelProto:
    node = relu("image", "feature")
    node.attribute.add(name="all", type=onnx.AttributeProto.TENSORS).tensors.append(data)
    return model_of([node], [])


def in_a_sparse_tensor(data: TensorProto) -> ModelProto:
    model = model_of([relu("image", "feature")], [])
    model.graph.sparse_initializer.add().values.CopyFrom(data)
    return model


def in_a_branch(data: TensorProto) -> ModelProto:
    branch = graph_with(data)
    node = helper.make_node("If", ["yes"], ["feature"], then_branch=branch, else_branch=branch)
    return model_of([node], [tensor("yes", True, np.bool_)])


def in_a_branch_of_a_branch(data: TensorProto) -> ModelProto:
    inner = in_a_branch(data).graph
    node = helper.make_node("If", ["yes"], ["feature"], then_branch=inner, else_branch=inner)
    return model_of([node], [tensor("yes", True, np.bool_)])


def in_a_function(data: TensorProto) -> ModelProto:
    model = model_of([relu("image", "feature")], [])
    inner = in_a_constant(data).graph.node
    model.functions.append(helper.make_function("own", "F", [], [], list(inner), []))
    return model


def in_the_training(data: TensorProto) -> ModelProto:
    model = model_of([relu("image", "feature")], [])
    model.training_info.add().algorithm.CopyFrom(graph_with(data))
    return model


WHERE: list[Callable[[TensorProto], ModelProto]] = [
    in_the_graph,
    in_a_constant,
    in_a_list,
    in_a_sparse_tensor,
    in_a_branch,
    in_a_branch_of_a_branch,
    in_a_function,
    in_the_training,
]


@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("location", ["/etc/passwd", "../../secret", "weights.bin", ""])
def test_data_in_other_files_is_refused_wherever_a_network_names_it(
    where: Callable[[TensorProto], ModelProto], location: str
) -> None:
    assert "keeps data in other files" in refusal(network_of(where(elsewhere(location))))


@pytest.mark.parametrize("where", WHERE)
def test_half_a_mention_of_data_in_other_files_is_one(
    where: Callable[[TensorProto], ModelProto],
) -> None:
    only_said, only_named = elsewhere("x"), elsewhere("x")
    only_said.ClearField("external_data")
    only_named.ClearField("data_location")
    for data in (only_said, only_named):
        assert "keeps data in other files" in refusal(network_of(where(data)))


def test_data_that_is_said_to_be_in_the_file_is_taken() -> None:
    here = tensor("weight", np.ones((1, 3, HEIGHT, WIDTH)), np.float32)
    here.data_location = TensorProto.DEFAULT
    network = network_of(in_the_graph(here))
    check_onnx("net", network.onnx)
    try_network("net", network)


def chain(count: int) -> ModelProto:
    names = ["image", *map(str, range(count - 1)), "feature"]
    return model_of([relu(*pair) for pair in pairwise(names)], [])


def within(count: int) -> ModelProto:
    """Return a network that has its nodes in a branch."""
    inner = chain(count).graph
    node = helper.make_node("If", ["yes"], ["feature"], then_branch=inner, else_branch=inner)
    return model_of([node], [tensor("yes", True, np.bool_)])


@pytest.mark.parametrize("model", [chain, within])
def test_a_network_of_too_many_nodes_is_refused_before_it_is_loaded(
    model: Callable[[int], ModelProto],
) -> None:
    assert f"more than {MOST_NODES} nodes" in refusal(network_of(model(MOST_NODES + 1)))


@pytest.mark.parametrize("junk", [b"\x9a\x01\x00", b"\x42\x00"], ids=["unknown", "known"])
def test_a_network_of_too_much_besides_is_refused(junk: bytes) -> None:
    network = network_of(chain(1))
    padded = Network(network.input, np.frombuffer(network.onnx.tobytes() + junk * 10**6, np.uint8))
    assert "fields; use a smaller" in refusal(padded)


def test_a_network_that_ends_the_process_ends_another_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    python = tmp_path / "python"  # no network is known that ends onnxruntime
    python.write_text("#!/bin/sh\ncat > /dev/null\nkill -SEGV $$\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    assert "crashes the process that runs it (SIGSEGV)" in refusal(network_of(chain(3)))


def beyond_the_image() -> ModelProto:
    gather = helper.make_node("GatherND", ["image", "i"], ["feature"])
    return model_of([gather], [tensor("i", [[0, 2**30, 0]])])


def test_a_network_that_reads_beyond_the_image_is_refused() -> None:
    assert "does not run on 24×16 pixels: " in refusal(network_of(beyond_the_image()))


def called(domain: str, name: str) -> ModelProto:
    model = model_of([helper.make_node(name, ["image"], ["feature"], domain=domain)], [])
    model.opset_import.append(helper.make_opsetid(domain, 1))
    return model


def defined(domain: str, name: str) -> ModelProto:
    """Return a network that brings the operator as a function."""
    model = called(domain, name)
    opset = helper.make_opsetid("", 17)
    body = [relu("x", "y")]
    model.functions.append(helper.make_function(domain, name, ["x"], ["y"], body, [opset]))
    return model


@pytest.mark.parametrize("domain", ["own", "com.microsoft", "ai.onnx.ml"])
def test_an_operator_that_is_not_of_the_standard_is_refused(domain: str) -> None:
    reason = f"operator '{domain}.EPContext' is not of the ONNX standard"
    assert reason in refusal(network_of(called(domain, "EPContext")))


def test_an_operator_that_the_network_defines_is_taken_unless_it_is_named_as_onnxruntimes() -> None:
    try_network("net", network_of(defined("own", "EPContext")))
    assert "ONNX standard" in refusal(network_of(defined("com.microsoft", "EPContext")))


def test_a_network_that_wants_much_memory_is_refused() -> None:
    tile = helper.make_node("Tile", ["image", "times"], ["feature"])
    refusal(network_of(model_of([tile], [tensor("times", [10**6 * 5, 1, 1, 1])])))


def endless_loop() -> ModelProto:
    value = helper.make_tensor_value_info
    nodes = [helper.make_node("Identity", [name], [f"next {name}"]) for name in ("go on", "x")]
    taken = [value("i", TensorProto.INT64, []), value("go on", TensorProto.BOOL, [])]
    given = [value("next go on", TensorProto.BOOL, []), value("next x", TensorProto.FLOAT, None)]
    body = helper.make_graph(nodes, "body", [*taken, value("x", TensorProto.FLOAT, None)], given)
    loop = helper.make_node("Loop", ["", "yes", "image"], ["feature"], body=body)
    return model_of([loop], [tensor("yes", True, np.bool_)])


def test_a_network_that_takes_too_long_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network_sandbox, "_WITHIN_S", 2)
    assert "within 2 s" in refusal(network_of(endless_loop()))


def test_a_network_that_is_refused_is_so_each_time_and_one_that_works_is_tried_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bad = network_of(beyond_the_image())
    assert refusal(bad) == refusal(bad)
    path = tmp_path / "net.onnx"
    write_network(path)
    feature_of(f"onnx:{path}")
    monkeypatch.setattr(network_sandbox, "_WITHIN_S", 0.0)
    pixels: NDArray[np.uint8] = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    assert feature_of(f"onnx:{path}").describe(pixels).dtype == np.float32


def test_what_the_process_says_no_to_is_said_here(tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    write_network(path, width=WIDTH - 1)
    with pytest.raises(ConfigError, match=f"net.onnx: its input is .* x {WIDTH}, not"):
        feature_of(f"onnx:{path}")
