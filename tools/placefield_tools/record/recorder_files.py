"""Choice of the recorder by the suffix of the file; other packages may add suffixes."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from placefield.config import MatchingConfig
from placefield.errors import ConfigError
from placefield.files import sync
from placefield.maps.geography import Origin
from placefield.plugins import Group, has_plugin, load_plugin
from placefield_tools.common.outputs import check_folder_of
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import RecordingError
from placefield_tools.record.text import record_csv, record_json_lines

_TEXT = {".jsonl": record_json_lines, ".csv": record_csv}
_RICH = (".mcap", ".rrd")
_PRECISION = MatchingConfig().precision
_RECORDERS: Group = "placefield.recorders"


def recorder_of(
    path: Path,
    *,
    origin: Origin | None = None,
    frames: bool = False,
    precision: float = _PRECISION,
) -> AbstractContextManager[Recorder]:
    """Return the recorder of a file, for a ``with`` block, which creates the file.

    Args:
        path: of the file.
        origin: georeference of the map; with it, geographic positions are recorded, too.
        frames: whether to record images of the query frames, too.
        precision: the probability from which on a match is known; drawn in ``.rrd``.

    Raises:
        RecordingError: the file exists already, or (inside the block) cannot be written.
        ConfigError: there is no such kind of recording, or it cannot hold images or positions; or
            there is no such folder, or a library is missing.
    """
    is_ours = path.suffix in (*_TEXT, *_RICH)
    if not is_ours and not has_plugin(_RECORDERS, path.suffix[1:]):
        raise ConfigError(f"{path}: unknown suffix; use .jsonl, .csv, .mcap or .rrd")
    if path.exists():
        raise RecordingError(f"{path}: exists already; remove it, or name another file")
    check_folder_of(path)
    if not is_ours:
        plugin = load_plugin(_RECORDERS, path.suffix[1:])
        return _with_known_errors(path, _with_pictures(path, plugin(path, origin), frames))
    if path.suffix in _RICH:
        return _with_known_errors(path, _rich(path, origin, frames=frames, precision=precision))
    if frames or origin is not None:
        flag = "--frames" if frames else "--map"
        raise ConfigError(f"{flag}: only .mcap and .rrd hold that, and {path} is neither")
    return _with_known_errors(path, _TEXT[path.suffix](path))


@contextmanager
def _with_pictures(
    path: Path, into: AbstractContextManager[Recorder], frames: bool
) -> Iterator[Recorder]:
    """Refuse a recorder of another package that cannot record images, if these are wanted."""
    with into as recorder:
        if frames and not recorder.has_pictures:
            raise ConfigError(f"--frames: a recording {path.suffix} holds no images; leave it out")
        yield recorder


@contextmanager
def _with_known_errors(path: Path, into: AbstractContextManager[Recorder]) -> Iterator[Recorder]:
    """Wrap a recorder: sync the file at the end, and turn errors of the disk into known errors."""
    try:
        with into as recorder:
            yield recorder
        sync(path)
    except OSError as error:
        if error.filename not in (None, str(path)):
            raise
        reason = error.strerror or error
        raise RecordingError(
            f"{path}: cannot be written any more: {reason}; the recording ends there"
        ) from None


def _rich(
    path: Path, origin: Origin | None, *, frames: bool, precision: float
) -> AbstractContextManager[Recorder]:
    try:
        if path.suffix == ".mcap":
            from placefield_tools.record.mcap_file import record_mcap

            return record_mcap(path, origin)
        from placefield_tools.record.rerun_file import record_rerun

        return record_rerun(path, origin, frames=frames, precision=precision)
    except ModuleNotFoundError as missing:
        extra = "record" if path.suffix == ".mcap" else "rerun"
        raise ConfigError(
            f"record to {path.suffix} needs {missing.name}: pip install 'placefield[{extra}]'"
        ) from None
