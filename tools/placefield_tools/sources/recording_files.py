"""Which files and folders are recordings."""

from pathlib import Path

from placefield.errors import ConfigError
from placefield_tools.common.natural_sort import in_natural_order
from placefield_tools.sources.folder import IMAGE_SUFFIXES, LISTING

_SUFFIXES = (".bag", ".db3", ".mcap")
_BAG_FOLDER = "metadata.yaml"


def is_recording(path: Path) -> bool:
    """Return whether a path is of a recording: a file, or a bag folder of ROS 2."""
    if path.suffix.lower() in _SUFFIXES:
        return path.is_file()
    return (path / _BAG_FOLDER).is_file()


def recordings_in(path: Path) -> list[Path]:
    """Return the recordings in a folder without images; a bag's own folder is none."""
    if not path.is_dir():
        return []
    files = [file for file in path.iterdir() if not file.name.startswith(".")]
    if any(file.suffix.lower() in IMAGE_SUFFIXES or file.name == LISTING for file in files):
        return []
    by_name = {str(file): file for file in files if is_recording(file)}
    return [by_name[name] for name in in_natural_order(by_name)]


def holds_recordings(path: Path) -> bool:
    """Return whether a source is a recording, or a folder of recordings."""
    return is_recording(path) or bool(recordings_in(path))


def not_installed(name: str, missing: ModuleNotFoundError) -> ConfigError:
    """Return the error of a recording that cannot be read without an optional package."""
    return ConfigError(f"{name} needs {missing.name}: pip install 'placefield[ros]'")
