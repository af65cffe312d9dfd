"""Our sources hold nothing that runs or unpickles what comes from outside."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(
    file for part in ("shared", "services", "tools") for file in (ROOT / part).rglob("*.py")
)
UNPICKLERS = {"cloudpickle", "dill", "joblib", "jsonpickle", "marshal", "pickle", "shelve", "yaml"}
EVALUATORS = {"__import__", "compile", "eval", "exec"}


def offences(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                yield from (name.name for name in names if is_unpickler(name.name))
            case ast.ImportFrom(module=str(module)) if is_unpickler(module):
                yield module
            case ast.Name(id=name) if name in EVALUATORS:
                yield name
            case ast.keyword(arg="allow_pickle" | "shell", value=value) if not is_false(value):
                yield ast.unparse(node)
            case ast.Attribute(value=ast.Name(id="os"), attr="system" | "popen"):
                yield ast.unparse(node)


def is_unpickler(module: str) -> bool:
    return module.partition(".")[0] in UNPICKLERS


def is_false(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and value.value is False


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "import os, yaml",
        "from joblib import load",
        "eval('1')",
        "list(map(exec, lines))",
        "np.load(file, allow_pickle=True)",
        "np.load(file, allow_pickle=wanted)",
        "subprocess.run(command, shell=True)",
        "os.system(command)",
    ],
)
def test_what_is_looked_for_is_found(source: str) -> None:
    assert len(list(offences(ast.parse(source)))) == 1


def test_nothing_is_unpickled_evaluated_or_loaded_as_yaml() -> None:
    assert len(SOURCES) > 100
    found = {
        str(file.relative_to(ROOT)): list(offences(ast.parse(file.read_bytes())))
        for file in SOURCES
    }
    assert {file: own for file, own in found.items() if own} == {}
