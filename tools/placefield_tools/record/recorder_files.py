"""A file to record into, by its suffix, which may be one that another package brings."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from placefield.errors import ConfigError
from placefield.files import sync
from placefield.maps.geography import Origin
from placefield.plugins import Group, has_plugin, load_plugin
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import RecordingError
from placefield_tools.record.text import record_csv, record_json_lines

_TEXT = {".jsonl": record_json_lines, ".csv": record_csv}
_RICH = (".mcap", ".rrd")
_RECORDERS: Group = "placefield.recorders"


def recorder_of(
    path: Path, *, origin: Origin | None = None, frames: bool = False
) -> AbstractContextManager[Recorder]:
    """Return what writes this file inside a ``with`` block; it is not made before.

    Args:
        path: of the file.
        origin: of the map's metres, where positions on earth are to be written, too.
        frames: whether pictures of the query frames are to be written, too.

    Raises:
        RecordingError: the file is there already; inside the block, it cannot be written.
        ConfigError: there is no such kind of recording, it does not hold what it is to hold, or a
            library is missing.
    """
    is_ours = path.suffix in (*_TEXT, *_RICH)
    if not is_ours and not has_plugin(_RECORDERS, path.suffix[1:]):
        raise ConfigError(f"{path}: name it .jsonl, .csv, .mcap or .rrd, as it is to be written")
    if path.exists():
        raise RecordingError(f"{path}: is there already; remove it, or name another file")
    if not is_ours:
        brought = load_plugin(_RECORDERS, path.suffix[1:])
        return _told(path, _with_pictures(path, brought(path, origin), frames))
    if path.suffix in _RICH:
        return _told(path, _rich(path.suffix)(path, origin))
    if frames or origin is not None:
        flag = "--frames" if frames else "--map"
        raise ConfigError(f"{flag}: only .mcap and .rrd hold that, and {path} is neither")
    return _told(path, _TEXT[path.suffix](path))


@contextmanager
def _with_pictures(
    path: Path, into: AbstractContextManager[Recorder], frames: bool
) -> Iterator[Recorder]:
    """Refuse a recorder of another package that holds no pictures, where there are to be some."""
    with into as recorder:
        if frames and not recorder.has_pictures:
            raise ConfigError(f"--frames: a recording {path.suffix} holds no pictures")
        yield recorder


@contextmanager
def _told(path: Path, into: AbstractContextManager[Recorder]) -> Iterator[Recorder]:
    """Write as ``into`` does, until it is with the disk; what that refuses is a known error."""
    try:
        with into as recorder:
            yield recorder
        sync(path)
    except OSError as error:
        if error.filename not in (None, str(path)):
            raise
        reason = error.strerror or error
        raise RecordingError(
            f"{path}: cannot be written any more: {reason}; it ends there"
        ) from None


def _rich(suffix: str) -> Callable[[Path, Origin | None], AbstractContextManager[Recorder]]:
    try:
        if suffix == ".mcap":
            from placefield_tools.record.mcap_file import record_mcap

            return record_mcap
        from placefield_tools.record.rerun_file import record_rerun

        return record_rerun
    except ModuleNotFoundError as missing:
        extra = "record" if suffix == ".mcap" else "rerun"
        raise ConfigError(
            f"record to {suffix} needs {missing.name}: pip install 'placefield[{extra}]'"
        ) from None
