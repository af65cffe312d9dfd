import pytest

from placefield.features.kinds import kinds_of


@pytest.mark.parametrize(
    ("kind", "parts"),
    [
        ("gist", ["gist"]),
        ("gist+onnx:net.onnx", ["gist", "onnx:net.onnx"]),
        ("onnx:a+b.onnx", ["onnx:a+b.onnx"]),
        ("onnx:/c+d/a+b.onnx+gist+own", ["onnx:/c+d/a+b.onnx", "gist", "own"]),
        ("onnx:a.onnx+onnx:b.onnx", ["onnx:a.onnx", "onnx:b.onnx"]),
    ],
)
def test_plus_signs_join_kinds_but_may_be_in_the_name_of_a_file(
    kind: str, parts: list[str]
) -> None:
    assert list(kinds_of(kind)) == parts
