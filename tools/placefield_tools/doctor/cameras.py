"""The cameras of this machine."""

from collections.abc import Iterator
from pathlib import Path

from placefield.errors import SourceError
from placefield_tools.doctor.finding import Finding, bad, good, warning
from placefield_tools.sources import open_source

_DEVICES = Path("/dev")


def cameras(source: str | None) -> Iterator[Finding]:
    """Look at a camera if one is named, else at which there are."""
    if source is not None:
        yield of_camera(source)
        return
    found = sorted(device.name for device in _DEVICES.glob("video[0-9]*"))
    if found:
        yield good("camera", f"{', '.join(found)}; try one with --camera camera:0")
    else:
        advice = "none needed for folders, videos, recordings and cameras on the network"
        yield warning("camera", "none at this machine", advice)


def of_camera(source: str) -> Finding:
    """Take a frame of a camera."""
    try:
        with open_source(source) as opened:
            frame = next(iter(opened))
    except (SourceError, StopIteration) as error:
        return bad("camera", str(error) or f"{source} gives no frame", "try another number or URL")
    shape = "" if isinstance(frame.image, bytes) else f" of {frame.image.shape[1::-1]} pixels"
    return good("camera", f"{source} gives frames{shape}")
