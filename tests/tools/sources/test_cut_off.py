"""Only of what is cut off is that asked."""

from pathlib import Path

import pytest
from test_ros_recording import images, record

from placefield.errors import SourceError
from placefield_tools.sources import open_source
from placefield_tools.sources.cut_off import is_cut_off

FORMS = ["ros1", "sqlite3", "mcap"]


def file_of(where: Path) -> Path:
    return where if where.is_file() else next(p for p in where.iterdir() if p.suffix != ".yaml")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0, 0.001, 0.1, 0.5, 0.95, 0.999])
def test_what_is_cut_off_is_seen(tmp_path: Path, form: str, share: float) -> None:
    where = Path(record(tmp_path / "drive", images(), form))
    assert not is_cut_off(where)
    file = file_of(where)
    assert not is_cut_off(file)
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    assert is_cut_off(where)
    assert is_cut_off(file)
    with pytest.raises(SourceError, match=r"was it cut off\?; if it is damaged, try '"):
        list(open_source(str(where)))


@pytest.mark.parametrize("form", FORMS)
def test_what_is_something_else_is_not_cut_off(tmp_path: Path, form: str) -> None:
    file = file_of(Path(record(tmp_path / "drive", images(), form)))
    file.write_bytes(b"something else, of another program. " * 300)
    with pytest.raises(SourceError, match="cannot be read as a recording") as refused:
        list(open_source(str(file)))
    assert form == "sqlite3" or "cut off" not in str(refused.value)
    assert len(str(refused.value)) < 400
