"""The page on the bus leaves out nothing that is said on it."""

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from placefield.bus import (
    candidate_messages,
    inbox,
    maps,
    message,
    messages,
    replay_cache,
    verified_messages,
)
from placefield.bus.credits import WINDOW
from placefield.bus.keys import Keys
from placefield.bus.maps import MapKeys
from placefield.bus.message import Message, OfMap
from placefield_tools.dashboard.count_words import MEANINGS

SOURCES = Path(__file__).resolve().parents[2]
NAMES = {
    "worker": "WORKER",
    "service": "SERVICE",
    "identity": "ID",
    "key": "placefield/RUN/NAME",
    "server": "ID",
    "digest": "DIGEST",
    "file": "FILE",
    "number": "NUMBER",
}
"""What the page calls the parameters of keys."""


@pytest.fixture(scope="module")
def bus_page(page: Callable[[str], str]) -> str:
    return page("bus")


def keys_of(keys: Any) -> Iterator[str]:
    """Yield what all properties and methods of keys return."""
    for name, member in vars(type(keys)).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            yield getattr(keys, name)
        elif inspect.isfunction(member):
            needed = [
                parameter.name
                for parameter in inspect.signature(member).parameters.values()
                if parameter.name != "self" and parameter.default is parameter.empty
            ]
            yield getattr(keys, name)(*(NAMES[name] for name in needed))


def is_of(pattern: str, key: str) -> bool:
    """Whether a key expression includes a key, or is it."""
    expression = re.escape(pattern).replace(r"\*\*", ".+").replace(r"\*", "[^/]+")
    return re.fullmatch(expression, key) is not None


def models() -> set[type[BaseModel]]:
    found: set[type[BaseModel]] = set()
    for module in (message, messages, candidate_messages, verified_messages, maps):
        for _, each in inspect.getmembers(module, inspect.isclass):
            if issubclass(each, Message) and each.__name__[0] != "_":
                found.add(each)
    return found - {Message, OfMap}  # roots


def fields_of(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield name
        for part in get_args(field.annotation):
            if (
                part is candidate_messages.SmoothedFrames
                and model is not candidate_messages.CandidatesMessage
            ):
                continue  # said once
            if inspect.isclass(part) and issubclass(part, BaseModel):
                yield from fields_of(part)


def section_on(model: type[BaseModel], page: str) -> str:
    """Return what the page says of a message, up to the next one or the next heading."""
    parts = re.split(rf"(?:\*\*|### ){model.__name__}\b", page)
    assert len(parts) == 2, f"{model.__name__} must have one section"
    return re.split(r"\n(?:#|\*\*\w+(?:Message|Query)\*\*)", parts[1])[0]


def counted() -> set[str]:
    """Return the names under which services and library count."""
    names = {"verified", *get_args(verified_messages.Unverified)}
    for part in ("shared", "services"):
        for file in (SOURCES / part).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_bytes())):
                match node:
                    case (
                        ast.AugAssign(target=ast.Subscript(slice=ast.Constant(value=str(name))))
                        | ast.Call(
                            func=ast.Attribute(attr="_count" | "_counted"),
                            args=[ast.Constant(value=str(name))],
                        )
                    ):
                        names.add(name)
    return names


def test_the_page_has_all_keys_and_no_others(bus_page: str) -> None:
    on_page = {
        key for key in re.findall(r"^\| `(placefield/[^`]+)`", bus_page, re.MULTILINE) if key
    }
    keys = {*keys_of(Keys("RUN")), *keys_of(MapKeys("MAP"))}
    assert len(keys) > 15
    assert [key for key in keys if not any(is_of(key, other) for other in on_page)] == []
    assert [key for key in on_page if not any(is_of(other, key) for other in keys)] == []


def test_the_page_has_all_fields_of_all_messages(bus_page: str) -> None:
    assert len(models()) > 10
    for model in models():
        section = section_on(model, bus_page)
        missing = [
            name
            for name in fields_of(model)
            if f"`{name}`" not in section and name != "version"  # said once for all
        ]
        assert missing == [], model.__name__


def test_the_page_has_all_counts_and_no_others_and_the_dashboard_a_meaning_of_each(
    bus_page: str, rows: Callable[[str], list[list[str]]]
) -> None:
    table = bus_page.partition("## What is counted")[2]
    on_page = {name for row in rows(table) for name in re.findall(r"`(\w+)`", row[0])}
    assert on_page == counted() == set(MEANINGS)


def test_the_page_has_the_limits_in_force(bus_page: str) -> None:
    assert f"has {WINDOW} frames under way at most" in bus_page
    assert f"{message.MAX_BYTES // 2**20} MiB a message" in bus_page
    assert f"keeps {inbox.CAPACITY} messages or {inbox.CAPACITY_BYTES // 2**30} GiB" in bus_page
    for name, kept in (("feature", replay_cache.LENGTH), ("moments", replay_cache.MOMENTS)):
        assert f"| `{name}` | {kept} |" in bus_page
