"""The page on tuning has every setting, with its default."""

from collections.abc import Callable, Iterator
from typing import Any

from pydantic import BaseModel

from placefield.config import Config


def settings_of(section: BaseModel, lead: str = "") -> Iterator[tuple[str, Any]]:
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, BaseModel):
            yield from settings_of(value, f"{lead}{name}.")
        else:
            yield lead + name, value


def is_shown(value: Any, cell: str) -> bool:
    """Whether a cell says what a default is, or, of none, anything else."""
    match value:
        case None | ():
            return "`" not in cell.partition(" for ")[0]
        case (str(only),):
            return cell == f"`{only}`"
        case bool() | str():
            return cell == f"`{str(value).lower()}`"
        case (float(), *_):
            return cell == str(list(value))
        case _:
            return cell == str(value)


def test_the_page_has_all_settings_and_no_others(
    page: Callable[[str], str], rows: Callable[[str], list[list[str]]]
) -> None:
    on_page = {row[0].strip("`"): row[1] for row in rows(page("tuning"))}
    settings = dict(settings_of(Config()))
    assert on_page.keys() == settings.keys()
    for key, default in settings.items():
        assert is_shown(default, on_page[key]), key
