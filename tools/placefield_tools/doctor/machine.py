"""The machine: cores, memory, disk, and where compiled loops are kept."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from placefield_tools.common.parallel import cores
from placefield_tools.doctor.finding import Finding, good, warning

_LEAST_CORES = 2
_LEAST_MEMORY = 2 * 2**30  # bytes
_LEAST_SHARED = 64 * 2**20  # bytes
_LEAST_DISK = 2**30  # bytes
_SHARED_MEMORY = Path("/dev/shm")


def machine() -> Iterator[Finding]:
    """Look at what the machine has, and how busy it is."""
    yield of_cores(cores(), os.getloadavg()[0])
    yield of_memory(_memory_available())
    yield of_shared_memory(_SHARED_MEMORY)
    yield of_disk(Path())
    yield compiled_loops(Path(os.environ.get("NUMBA_CACHE_DIR") or _package_folder()))


def of_cores(count: int, load: float) -> Finding:
    """Look at the cores that this process may use, and the load of the last minute."""
    found = f"{count}, load {load:.1f}"
    if count < _LEAST_CORES:
        advice = "fewer channels (build --channels 2) or a second host; see 'placefield plan'"
        return warning("cores", found, advice)
    if load > count:
        return warning("cores", found, "others are at work: frames will take longer")
    return good("cores", found)


def of_memory(available: int) -> Finding:
    """Look at the memory that can be had, bytes."""
    found = f"{available / 2**30:.1f} GiB available"
    if available < _LEAST_MEMORY:
        advice = "a service takes about 0.2 GiB and its share of the map; start fewer workers"
        return warning("memory", found, advice)
    return good("memory", found)


def of_shared_memory(folder: Path) -> Finding:
    """Look at shared memory, which services do without and a router of your own may want."""
    if not folder.is_dir():
        return warning("shared memory", f"no {folder}", "leave shared memory off in zenohd")
    free = shutil.disk_usage(folder).free
    found = f"{free / 2**20:.0f} MiB free; our services do without"
    if free < _LEAST_SHARED:
        advice = "give a container --shm-size=256m, or leave shared memory off in zenohd"
        return warning("shared memory", found, advice)
    return good("shared memory", found)


def of_disk(folder: Path) -> Finding:
    """Look at the room that is left for maps and recordings."""
    try:
        free = shutil.disk_usage(folder).free
        found = f"{free / 2**30:.1f} GiB free at {folder.resolve()}"
    except OSError:
        return warning("disk", "this folder is gone", "go to one that is there")
    if free < _LEAST_DISK:
        return warning("disk", found, "make room: a map that does not fit is not written")
    return good("disk", found)


def compiled_loops(folder: Path) -> Finding:
    """Look whether what is compiled at first use can be kept."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return good("compiled loops", f"kept in {folder}")
    except OSError as error:
        advice = "set NUMBA_CACHE_DIR to a folder that is yours, or every start compiles them again"
        return warning("compiled loops", f"{folder}: {error.strerror}", advice)


def _package_folder() -> Path:
    import placefield.matching

    return Path(placefield.matching.__path__[0])


def _memory_available() -> int:
    lines = Path("/proc/meminfo").read_text().splitlines()
    kilobytes = dict(line.split(":", 1) for line in lines)["MemAvailable"].split()[0]
    return int(kilobytes) * 1024
