"""The page of the library has each public name, once, by where it is at home."""

import re
from collections.abc import Callable
from importlib import import_module

import placefield


def test_the_page_has_every_public_name_and_no_other(page: Callable[[str], str]) -> None:
    shown = re.findall(r"^::: (\S+)\.(\w+)$", page("reference"), re.MULTILINE)
    assert sorted(name for _, name in shown) == sorted(placefield.__all__)
    for module, name in shown:
        assert getattr(import_module(module), name) is getattr(placefield, name)
