"""A host that explores a drive, and has its map at the end."""

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path

from placefield.bus.keys import Keys
from placefield.bus.session import Bus
from placefield.errors import ConfigError, MapError, PlacefieldError
from placefield.features.extract import feature_of
from placefield.maps.drive_file import DriveFile
from placefield.maps.manifest import check_map_path
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_services.exploring_services import check_exploring
from placefield_services.host import run_host
from placefield_services.mapper import drive_path, ended_path
from placefield_tools.common.natural_sort import counted
from placefield_tools.common.outputs import make_folder
from placefield_tools.explore.explored_map import AskedMap, build_explored
from placefield_tools.up.program import PROGRAM
from placefield_tools.up.service_commands import GATEWAY

log = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.2


def check_explored(asked: AskedMap) -> None:
    """Refuse a map that exists, and settings that cannot explore.

    Raises:
        ConfigError: the map exists, or its folder cannot be made; the rule or the feature cannot
            explore; the camera has no view; or there are several runs.
        MapError: the path does not end in ``.pfmap``.
    """
    path, config = asked.path, asked.config
    check_map_path(path)
    if path.exists():
        raise ConfigError(f"{path}: exists already; name another map, or leave --explore out")
    make_folder(path.parent)
    check_exploring(config.matching)
    _ = config.run
    feature_of(config.features.kind, config.inference)
    _ = asked.view


def explore(
    asked: AskedMap,
    commands: Mapping[str, Sequence[str]],
    stop: threading.Event,
    on_stop: Callable[[], None] = lambda: None,
) -> bool:
    """Explore one drive, and save its map; return whether the map is there.

    The services go on until the map is saved and no source of frames is alive. There is no map of a
    drive with too little in it; then the next drive is explored. If the map cannot be saved, the
    drive is kept, and ``explore`` builds its map when it is called again.

    Args:
        asked: the map.
        commands: command lines of the services, by name.
        stop: ends the exploration; the map is of the drive so far.
        on_stop: called then, before the map is built, which may take minutes.

    Raises:
        BusError: see ``run_host``.
        ConfigError: the drive that an earlier call has kept was explored by another feature, or
            rectified for another camera.
        MapError: the map of a drive that an earlier call has kept cannot be saved, or another
            process explores it.
        OSError: the drive of an earlier call cannot be read.
    """
    path, config = asked.path, asked.config
    if _finish_drive(asked):
        log.warning("%s: an earlier exploration has left its drive; building its map", path)
        built = _build(asked)
        if built is not None:
            _save(built, path)
            return True
    builder = _Builder(asked, stop)
    builder.start()
    run = Keys(config.run)
    sources = ("replay",) if GATEWAY in commands else ()
    replaying = "" if sources else "'placefield replay SOURCE' and "

    def is_over(bus: Bus) -> bool:
        return builder.is_done and not bus.alive(run.all_alive("replay"))

    def ready() -> None:
        print(
            f"ready: run {config.run!r} at {config.bus.endpoint}, exploring; "
            f"now {replaying}'placefield listen'",
            flush=True,
        )

    describers = ("describer",) if "describer 0" in commands else ()
    others = ("mapper", *describers, *sources)
    run_host(PROGRAM, commands, 1, config, stop, ready, others=others, is_over=is_over)
    if stop.is_set():
        on_stop()
    builder.join()
    if not builder.is_done and not builder.has_failed and _finish_drive(asked):
        log.warning("%s: building the map; Ctrl-C keeps the drive, for a later --explore", path)
        builder.build()
    return builder.is_done


def _finish_drive(asked: AskedMap) -> bool:
    """Say that the drive is over, if there is one; return whether there is.

    Raises:
        ConfigError: see ``explore``.
        MapError: another process is exploring it.
        OSError: the disk fails.
    """
    path = asked.path
    for there in (drive_path(path), ended_path(path)):
        if there.exists():
            with closing(DriveFile(there)) as file:
                if file.drive.feature != asked.feature:
                    raise ConfigError(
                        f"{there}: was explored with another feature or camera; give the --feature "
                        "and --camera of then, or remove it"
                    )
                file.end(ended_path(path))
            return True
    return False


def _build(asked: AskedMap) -> Map | None:
    """Build the map of the drive that is over; None if there is too little of it, which is logged.

    Raises:
        OSError: the drive cannot be read.
    """
    drive = ended_path(asked.path)
    try:
        return build_explored(drive, asked)
    except MapError as error:
        log.error("%s: there is no map of this drive: %s", asked.path, error)
        drive.unlink()
        return None


def _save(built: Map, path: Path) -> None:
    save_map(built, path)
    ended_path(path).unlink()
    log.warning("%s: saved, %s", path, counted(built.places.count, "place"))


class _Builder(threading.Thread):
    """Builds the map of the first drive that is over and has one."""

    def __init__(self, asked: AskedMap, stop: threading.Event) -> None:
        super().__init__(daemon=True)
        self._asked, self._is_stopped = asked, stop
        self.is_done = False
        self.has_failed = False
        """Whether the map could not be saved; its drive is kept."""

    def run(self) -> None:
        while not (self.is_done or self.has_failed):
            if ended_path(self._asked.path).exists():
                self.build()
            elif self._is_stopped.wait(_LOOK_EVERY_S):
                return

    def build(self) -> None:
        """Build and save the map of the drive that is over."""
        try:
            built = _build(self._asked)
            if built is not None:
                _save(built, self._asked.path)
                self.is_done = True
        except (PlacefieldError, OSError) as error:
            self.has_failed = True
            kept = ended_path(self._asked.path)
            log.error("%s; the drive is kept as %s: start again with --explore", error, kept)
