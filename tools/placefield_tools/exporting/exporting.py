"""Recorded matches into another format, by its suffix."""

from pathlib import Path

from placefield.errors import ConfigError
from placefield_tools.exporting.g2o import to_g2o
from placefield_tools.exporting.geojson import to_geojson
from placefield_tools.exporting.traverse import QueryTraverse
from placefield_tools.exporting.tum import to_tum


def check_suffix(path: Path) -> None:
    """Check that there is such a format.

    Raises:
        ConfigError: there is not.
    """
    if path.suffix not in _FORMATS:
        raise ConfigError(f"{path}: name it {', '.join(_FORMATS)}, as it is to be written")


def export(traverse: QueryTraverse, path: Path) -> None:
    """Write the traverse to a file whose suffix names a format; one that is there is replaced.

    Raises:
        MapError: the format is for maps on earth, and this one is not.
        ConfigError: a library is missing.
    """
    path.write_text(_FORMATS[path.suffix](traverse), encoding="utf-8")


def _to_gpx(traverse: QueryTraverse) -> str:
    try:
        from placefield_tools.exporting.gpx import to_gpx
    except ModuleNotFoundError as missing:
        raise ConfigError(
            f"export to .gpx needs {missing.name}: pip install 'placefield[record]'"
        ) from None
    return to_gpx(traverse)


_FORMATS = {".g2o": to_g2o, ".tum": to_tum, ".geojson": to_geojson, ".gpx": _to_gpx}
