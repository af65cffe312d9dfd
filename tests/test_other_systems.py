"""Systems other than Linux: all modules of ours are imported with none of Unix's own."""

import subprocess
import sys
from pathlib import Path

import pytest

from placefield.errors import ConfigError
from placefield.locking import take_lock

HIDDEN = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")

IMPORT_ALL = f"""
import builtins, importlib, pkgutil

whole = builtins.__import__

def hiding(name, globals=None, locals=None, fromlist=(), level=0):
    importer = (globals or {{}}).get("__name__", "")
    if name.partition(".")[0] in {HIDDEN} and importer.startswith("placefield"):
        raise ModuleNotFoundError(f"{{importer}} imports {{name}}", name=name)
    return whole(name, globals, locals, fromlist, level)

builtins.__import__ = hiding
count = 0
for package in ("placefield", "placefield_services", "placefield_tools"):
    folder = importlib.import_module(package).__path__
    for module in pkgutil.walk_packages(folder, package + "."):
        importlib.import_module(module.name)
        count += 1
print(count)
"""


def test_every_module_is_imported_where_unix_s_own_modules_are_missing() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) > 200


def test_a_module_of_ours_that_asks_for_one_of_them_is_found() -> None:
    hiding = IMPORT_ALL.partition("count = 0")[0]
    asking = f"{hiding}\n__name__ = 'placefield.made_up'\nimport fcntl"
    ended = subprocess.run(
        [sys.executable, "-c", asking], capture_output=True, text=True, check=False
    )
    assert "placefield.made_up imports fcntl" in ended.stderr


def test_where_no_file_can_be_locked_a_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "fcntl", None)
    with (
        (tmp_path / ".lock").open("ab") as opened,
        pytest.raises(ConfigError, match=r"\.lock: .*use Linux, macOS or WSL"),
    ):
        take_lock(opened)


def test_a_file_is_locked_once_until_it_is_closed(tmp_path: Path) -> None:
    file = tmp_path / ".lock"
    with file.open("ab") as first, file.open("ab") as second:
        assert take_lock(first)
        assert not take_lock(second)
        first.close()
        assert take_lock(second)
