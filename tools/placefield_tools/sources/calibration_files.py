"""The calibration of a camera: of a file in YAML, or of a recording."""

from pathlib import Path

from placefield.features.calibration import Calibration
from placefield.features.camera_file import read_camera
from placefield_tools.sources.recording_files import is_recording, not_installed, recordings_in


def calibration_in(file: Path, images: str | None = None) -> Calibration:
    """Return the calibration of a camera.

    Args:
        file: in YAML, see ``read_camera``; or a recording or a folder of recordings, see
            ``recorded_calibration``.
        images: the topic of the camera's images in a recording; None: the only one.

    Raises:
        ConfigError: the file in YAML is refused, or a library that reads recordings is not
            installed.
        SourceError: the recording is refused.
    """
    recordings = [file] if is_recording(file) else recordings_in(file)
    if not recordings:
        return read_camera(file)
    try:
        from placefield_tools.sources.recorded_calibration import recorded_calibration
    except ModuleNotFoundError as missing:
        raise not_installed(str(file), missing) from None
    return recorded_calibration(recordings, images)
