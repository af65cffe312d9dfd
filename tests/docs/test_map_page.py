"""The page on the map format leaves out nothing that a map holds."""

import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from placefield.maps.array_layout import (
    CHANCE_FILES,
    CHANNEL_FILES,
    COARSE_FILES,
    GRAPH_FILES,
    LIST_FILES,
    LOCAL_FEATURE_FILES,
    LOOK_CODE_FILES,
    LOOK_FILES,
    LOOK_TRAVERSE_FILES,
    MASK_FILES,
    MASK_FOLDER,
    METRIC_FILES,
    MODEL_FILES,
    NETWORK_FILES,
    PLACE_FILES,
    TRAVERSE_FILES,
)
from placefield.maps.manifest import MANIFEST, SEAL, Manifest

Rows = Callable[[str], list[list[str]]]

FOLDERS = (
    ("features", MODEL_FILES),
    ("features", NETWORK_FILES),
    (MASK_FOLDER, MASK_FILES),
    ("places", PLACE_FILES),
    ("traverses/1", TRAVERSE_FILES),
    ("graph", GRAPH_FILES),
    ("metrics/0", METRIC_FILES),
    ("metrics/0/coarse", COARSE_FILES),
    ("metrics/0/coarse/lists", LIST_FILES),
    ("metrics/0/looks", LOOK_FILES),
    ("metrics/0/looks", LOOK_CODE_FILES),
    ("metrics/0/looks", LOOK_TRAVERSE_FILES),
    ("channels/0", CHANNEL_FILES),
    ("local_features", LOCAL_FEATURE_FILES),
    ("local_features", CHANCE_FILES),
    ("local_features", NETWORK_FILES),
)


@pytest.fixture(scope="module")
def map_page(page: Callable[[str], str]) -> str:
    return page("map-format")


def fields_of(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield name
        for part in (field.annotation, *get_args(field.annotation)):
            if inspect.isclass(part) and issubclass(part, BaseModel):
                yield from fields_of(part)


def test_the_page_has_each_array_as_it_is_laid_out(map_page: str, rows: Rows) -> None:
    table = map_page.partition("## Arrays")[2].partition("## ")[0]
    on_page = {file.strip("`"): (dtype, axes.count(",")) for file, dtype, axes, _ in rows(table)}
    laid_out = {
        f"{folder}/{name}.npy": (dtype, len(axes) - 1)
        for folder, layout in FOLDERS
        for name, (dtype, axes) in layout.items()
    }
    assert on_page == laid_out


def test_the_page_has_every_file_of_a_map(map_page: str, map_path: Path) -> None:
    files = {str(file.relative_to(map_path)) for file in map_path.rglob("*") if file.is_file()}
    assert {MANIFEST, SEAL} < files
    for file in files:
        folder, _, rest = file.partition("/")
        named = (
            f"{folder}/{int(folder == 'traverses')}/{rest.partition('/')[2]}"
            if rest[:1].isdecimal()
            else file
        )
        assert named in map_page


def test_the_page_has_every_field_of_the_manifest(map_page: str, rows: Rows) -> None:
    table = map_page.partition("## The manifest")[2].partition("## ")[0]
    assert [row[0].strip("`") for row in rows(table)] == list(Manifest.model_fields)
    assert [name for name in fields_of(Manifest) if f"`{name}`" not in table] == []
