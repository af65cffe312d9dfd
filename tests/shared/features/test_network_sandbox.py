"""Networks that were made to do harm: refused in one line, by a process that lives on."""

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


def beyond_the_image(axis: int) -> ModelProto:
    indices = [[0, 0, 0]]
    indices[0][axis] = 2**30
    return model_of(
        [helper.make_node("GatherND", ["image", "i"], ["feature"])], [tensor("i", indices)]
    )


@pytest.mark.parametrize("axis", range(3))
def test_a_network_that_ends_the_process_ends_another_one(axis: int) -> None:
    assert "crashes the process that runs it" in refusal(network_of(beyond_the_image(axis)))


def test_a_network_that_wants_much_memory_is_refused() -> None:
    tile = helper.make_node("Tile", ["image", "times"], ["feature"])
    refusal(network_of(model_of([tile], [tensor("times", [10**6 * 5, 1, 1, 1])])))


def test_a_network_that_takes_too_long_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network_sandbox, "_WITHIN_S", 0.01)
    assert "within 0.01 s" in refusal(network_of(chain(2)))


def test_a_network_that_is_refused_is_so_each_time_and_one_that_works_is_tried_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bad = network_of(beyond_the_image(1))
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
    with pytest.raises(ConfigError, match=f"net.onnx: its input is CV_32FC1 .* x {WIDTH}, not"):
        feature_of(f"onnx:{path}")
