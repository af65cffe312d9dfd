"""Where compiled code is kept, and what happens where it can't be."""

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from placefield.kernels import pairwise_sum

PATIENCE_S = 240
"""For a process that compiles, on a machine that other work keeps busy."""

INTERRUPTED = """
import os, signal
from numba.core import event
from placefield.kernels import kernel

class Interrupting(event.Listener):
    def on_start(self, event):
        os.kill(os.getpid(), signal.SIGINT)
    def on_end(self, event):
        pass

@kernel
def twice(x):
    return 2 * x

signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
try:
    with event.install_listener("numba:compile", Interrupting()):
        twice(1)
except KeyboardInterrupt:
    print(len(twice.signatures), signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""

SUM = "import numpy as np; from placefield.kernels import sum_of; print(sum_of(np.ones(3)))"


def sum_in_another_process(
    cache: Path, prepare: Callable[[], None] | None = None
) -> "subprocess.CompletedProcess[str]":
    return in_another_process(SUM, prepare, NUMBA_CACHE_DIR=str(cache))


def in_another_process(
    program: str, prepare: Callable[[], None] | None = None, **settings: str
) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | settings,
        preexec_fn=prepare,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def leave_no_room() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


def test_machine_code_is_kept_for_the_next_process(tmp_path: Path) -> None:
    assert sum_in_another_process(tmp_path).stdout == "3.0\n"
    kept = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nbc")}
    assert kept
    assert sum_in_another_process(tmp_path).stdout == "3.0\n"
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nbc")} == kept


def test_ctrl_c_waits_until_a_function_is_compiled() -> None:
    ended = in_another_process(INTERRUPTED)
    assert ended.stdout == "1 True\n", ended.stderr  # compiled, and then interrupted


def test_kernels_also_run_interpreted_as_a_debugger_wants_them() -> None:
    done = in_another_process(SUM, NUMBA_DISABLE_JIT="1")
    assert (done.stdout, done.stderr) == ("3.0\n", "")


@pytest.mark.parametrize("cache", ["there", "/proc/nowhere"])
def test_where_it_cannot_be_kept_it_is_compiled_all_the_same(tmp_path: Path, cache: str) -> None:
    ended = sum_in_another_process(tmp_path / cache, leave_no_room)
    assert (ended.returncode, ended.stdout) == (0, "3.0\n"), ended.stderr
    assert not list(tmp_path.rglob("*.nbc"))


@pytest.mark.parametrize(
    ("outer", "inner"),
    [
        ("inner(x) + 1", "@kernel\ndef inner(x):\n    return {factor} * x\n"),
        ("inner * x + 1", "inner = {factor}\n"),
        ("inner * x + 1", "import numpy\ninner = numpy.int64({factor})\n"),
        ("inner[1] * x + 1", "import numpy\ninner = numpy.array([9, {factor}])\n"),
    ],
    ids=["function", "number", "numpy number", "array"],
)
def test_machine_code_is_compiled_again_where_a_constant_or_function_of_it_has_changed(
    tmp_path: Path, outer: str, inner: str
) -> None:
    (tmp_path / "outer.py").write_text(
        "from inner import inner\nfrom placefield.kernels import kernel\n"
        f"@kernel\ndef outer(x):\n    return {outer}\n"
    )

    def outer_of_ten(factor: int) -> str:
        (tmp_path / "inner.py").write_text(
            "from placefield.kernels import kernel\n" + inner.format(factor=factor)
        )
        path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
        return subprocess.run(
            [sys.executable, "-B", "-c", "from outer import outer; print(outer(10))"],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=True,
        ).stdout

    assert [outer_of_ten(2), outer_of_ten(3), outer_of_ten(2)] == ["21\n", "31\n", "21\n"]


def taken_from(folder: Path, name: str, fields: tuple[str, str]) -> str:
    """Return what a kernel takes as `first` of a named tuple of 2 and 5; its code is cached."""
    lines = "".join(f"    {field}: int\n" for field in fields)
    (folder / "pair.py").write_text(
        f"from typing import NamedTuple\nclass {name}(NamedTuple):\n{lines}"
    )
    taking = (
        f"from pair import {name}\nfrom placefield.kernels import kernel\n"
        f"@kernel\ndef first_of(pair: {name}):\n    return pair.first\n"
    )
    if not (folder / "taking.py").exists() or (folder / "taking.py").read_text() != taking:
        (folder / "taking.py").write_text(taking)
    code = f"from pair import {name}; from taking import first_of; print(first_of({name}(2, 5)))"
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, "-B", "-c", code],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    ).stdout


def test_machine_code_is_compiled_again_where_a_named_tuple_has_changed(tmp_path: Path) -> None:
    assert taken_from(tmp_path, "Pair", ("first", "second")) == "2\n"
    assert taken_from(tmp_path, "Pair", ("second", "first")) == "5\n"
    assert taken_from(tmp_path, "Couple", ("second", "first")) == "5\n"


@pytest.mark.parametrize("length", [0, 9])
@pytest.mark.parametrize("pattern", ["*.nbi", "*.nbc"])
def test_kept_machine_code_that_was_cut_off_is_compiled_again(
    tmp_path: Path, pattern: str, length: int
) -> None:
    assert sum_in_another_process(tmp_path).stdout == "3.0\n"
    for file in tmp_path.rglob(pattern):
        file.write_bytes(file.read_bytes()[:length])
    ended = sum_in_another_process(tmp_path)
    assert (ended.returncode, ended.stdout) == (0, "3.0\n"), ended.stderr


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 18, 36, 127, 128])
def test_a_pairwise_sum_is_that_of_numpy_to_the_last_bit(count: int) -> None:
    values = np.random.default_rng(count).normal(size=(100, count)) ** 5
    assert [pairwise_sum(some) for some in values] == [np.sum(some) for some in values]


def test_compiled_code_is_loaded_without_the_linear_algebra_of_scipy(tmp_path: Path) -> None:
    """Its import would take a quarter of the time in which a worker loads its compiled code."""
    ended = subprocess.run(
        [sys.executable, "-c", f"{SUM}; import sys; print('scipy.linalg' in sys.modules)"],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (0, "3.0\nFalse\n"), ended.stderr
