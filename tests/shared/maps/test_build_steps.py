from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.maps.build_steps import Arrays, Steps

VECTORS = np.arange(12, dtype=np.float32).reshape(4, 3)


class Step:
    """A step that counts how often it is carried out."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> Arrays:
        self.times += 1
        return np.arange(5, dtype=np.int32), np.array("a refusal")


def steps_in(
    folder: Path, vectors: NDArray[np.float32] = VECTORS, settings: str = "seed=0"
) -> Steps:
    return Steps(folder=folder).of([vectors], settings)


def test_a_finished_step_is_not_done_again(tmp_path: Path) -> None:
    step = Step()
    first = steps_in(tmp_path / "new").finish("clusters", step)
    again = steps_in(tmp_path / "new").finish("clusters", step)
    assert step.times == 1
    for one, other in zip(first, again, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "other", [(VECTORS + 1, "seed=0"), (VECTORS.reshape(3, 4), "seed=0"), (VECTORS, "seed=1")]
)
def test_of_other_inputs_it_is_done_again(
    tmp_path: Path, other: tuple[NDArray[np.float32], str]
) -> None:
    step = Step()
    for inputs in ((VECTORS, "seed=0"), other):
        steps_in(tmp_path, *inputs).finish("clusters", step)
    assert step.times == 2


@pytest.mark.parametrize("damage", [b"", b"PK", b"no archive"])
def test_a_damaged_file_is_no_finished_step(tmp_path: Path, damage: bytes) -> None:
    step = Step()
    steps_in(tmp_path).finish("clusters", step)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    for content in (damage, whole[:-30], whole.replace(b"a\0\0\0 ", b"b\0\0\0 ")):
        file.write_bytes(content)
        _, refusal = steps_in(tmp_path).finish("clusters", step)
        assert refusal.item() == "a refusal"
    assert step.times == 4


def test_where_nothing_can_be_kept_the_build_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    taken = tmp_path / "file"
    taken.touch()
    result, _ = steps_in(taken).finish("clusters", Step())
    assert len(result) == 5
    assert "not kept" in caplog.text


def test_without_a_folder_every_step_is_done() -> None:
    step = Step()
    for _ in range(2):
        Steps().of([VECTORS], "").finish("clusters", step)
    assert step.times == 2
