"""The cameras of this machine."""

import threading
from collections.abc import Iterator
from pathlib import Path

from placefield.errors import SourceError
from placefield_tools.doctor.finding import Finding, bad, good, warning
from placefield_tools.sources import open_source
from placefield_tools.sources.secrets import without_secrets

_DEVICES = Path("/dev")
_PATIENCE_S = 10.0
_ADVICE = "try another number or URL"


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
    """Take a frame of a camera, which has ten seconds for it."""
    stop = threading.Event()
    timer = threading.Timer(_PATIENCE_S, stop.set)
    timer.start()
    try:
        with open_source(source, stop=stop) as opened:
            frame = next(iter(opened), None)
    except SourceError as error:
        return bad("camera", str(error), _ADVICE)
    finally:
        timer.cancel()
    shown = without_secrets(source)
    if frame is None:
        return bad("camera", f"{shown} gives no frame", _ADVICE)
    shape = "" if isinstance(frame.image, bytes) else f" of {frame.image.shape[1::-1]} pixels"
    return good("camera", f"{shown} gives frames{shape}")
