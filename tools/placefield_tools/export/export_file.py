"""Exporting recorded matches to a format, by the suffix of the file."""

from pathlib import Path

from placefield.errors import ConfigError
from placefield.files import write_whole
from placefield_tools.common.outputs import check_folder_of
from placefield_tools.export.g2o import to_g2o
from placefield_tools.export.geojson import to_geojson
from placefield_tools.export.matched_traverse import QueryTraverse
from placefield_tools.export.tum import to_tum
from placefield_tools.record.records import RecordingError


def check_target(path: Path) -> None:
    """Check that the format of a file is known, and that it is a new file in a folder that exists.

    Raises:
        ConfigError: there is no such format, or no such folder.
        RecordingError: the file exists already.
    """
    if path.suffix not in _FORMATS:
        raise ConfigError(f"{path}: unknown suffix; use one of {', '.join(_FORMATS)}")
    if path.exists():
        raise RecordingError(f"{path}: exists already; remove it, or name another file")
    check_folder_of(path)


def export(traverse: QueryTraverse, path: Path) -> None:
    """Write the traverse to a file whose suffix names a format.

    Raises:
        MapError: the format needs a georeferenced map, and this map is none.
        ConfigError: a library is missing.
        OSError: the file cannot be written.
    """
    write_whole(path, _FORMATS[path.suffix](traverse))


def _to_gpx(traverse: QueryTraverse) -> str:
    try:
        from placefield_tools.export.gpx import to_gpx
    except ModuleNotFoundError as missing:
        raise ConfigError(
            f"export to .gpx needs {missing.name}: pip install 'placefield[record]'"
        ) from None
    return to_gpx(traverse)


_FORMATS = {".g2o": to_g2o, ".tum": to_tum, ".geojson": to_geojson, ".gpx": _to_gpx}
