"""Recorded matches into another format, by its suffix."""

from pathlib import Path

from placefield.errors import ConfigError
from placefield.files import write_whole
from placefield_tools.export.g2o import to_g2o
from placefield_tools.export.geojson import to_geojson
from placefield_tools.export.matched_traverse import QueryTraverse
from placefield_tools.export.tum import to_tum
from placefield_tools.record.records import RecordingError


def check_target(path: Path) -> None:
    """Check that there is such a format, and no file there yet.

    Raises:
        ConfigError: there is no such format.
        RecordingError: the file is there already.
    """
    if path.suffix not in _FORMATS:
        raise ConfigError(f"{path}: name it {', '.join(_FORMATS)}, as it is to be written")
    if path.exists():
        raise RecordingError(f"{path}: is there already; remove it, or name another file")


def export(traverse: QueryTraverse, path: Path) -> None:
    """Write the traverse to a file whose suffix names a format.

    Raises:
        MapError: the format is for maps on earth, and this one is not.
        ConfigError: a library is missing.
        OSError: it cannot be written.
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
