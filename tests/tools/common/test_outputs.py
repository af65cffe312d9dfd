from pathlib import Path

import pytest

from placefield.errors import ConfigError
from placefield_tools.common.outputs import check_folder, make_folder


def test_a_folder_that_can_be_made_is_not_made_yet(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    check_folder(tmp_path / "a" / "b")


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for refuse in (check_folder, make_folder):
        with pytest.raises(ConfigError, match=r"file.*the folder cannot be made"):
            refuse(tmp_path / "file" / "study")
