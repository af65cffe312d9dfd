"""Writing the loops of a drive to a file, by the suffix of the file."""

from pathlib import Path

from placefield.errors import ConfigError
from placefield.files import write_whole
from placefield_tools.common.outputs import check_folder_of
from placefield_tools.loops.finding import DriveLoops
from placefield_tools.loops.loop_graph import to_graph
from placefield_tools.loops.loop_tables import to_csv, to_json

_FORMATS = {".g2o": to_graph, ".csv": to_csv, ".json": to_json}


def check_output(path: Path) -> None:
    """Check that the format of a file is known, and that it is a new file in a folder that exists.

    Raises:
        ConfigError: it is not so.
    """
    if path.suffix not in _FORMATS:
        raise ConfigError(f"{path}: unknown suffix; use one of {', '.join(_FORMATS)}")
    if path.exists():
        raise ConfigError(f"{path}: exists already; remove it, or name another file")
    check_folder_of(path)


def write_loops(loops: DriveLoops, path: Path) -> None:
    """Write the loops to a file whose suffix names a format.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, _FORMATS[path.suffix](loops))
