"""Reads the calibration of a camera from a file of ROS (``camera_info``) or OpenCV, in YAML."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import YAMLError

from placefield.errors import ConfigError
from placefield.features.calibration import Calibration

_MOST_BYTES = 2**20

# The names that ROS, OpenCV's programs and its users give.
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")
_SIZE = ("image_size", "imageSize", "size")
_MATRIX = ("camera_matrix", "cameraMatrix", "K", "k", "M")
_DISTORTION = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "d")
_MODEL, _FISHEYE = ("distortion_model", "model"), ("fisheye_model", "fisheye")
_NAMES = {
    "width": (*_WIDTH, *_SIZE),
    "height": (*_HEIGHT, *_SIZE),
    "focal": _MATRIX,
    "centre": _MATRIX,
    "distortion": _DISTORTION,
}
"""The names of what a field of a calibration is made of."""

_MODELS = {
    "plumb_bob": "pinhole",
    "rational_polynomial": "pinhole",
    "pinhole": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}


class _Constructor(SafeConstructor):
    """Makes plain values only, and takes OpenCV's matrices as mappings."""


_Constructor.add_constructor("tag:yaml.org,2002:opencv-matrix", SafeConstructor.construct_yaml_map)


def read_camera(path: Path) -> Calibration:
    """Read the calibration of a camera.

    It is a ``camera_info`` of ROS, as ``camera_calibration`` or ``ros2 topic echo`` writes it, or a
    file of OpenCV's ``FileStorage``. The camera matrix and the distortion count; the rectification
    and the projection of ROS do not, as the view is chosen anew.

    Raises:
        ConfigError: the file cannot be read, or is no such calibration; the line names the file and
            the key.
    """
    try:
        with path.open("rb") as file:
            written = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        return calibration_of(_parse(written))
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None


def write_camera(calibration: Calibration, path: Path) -> None:
    """Write the calibration of a camera as ``read_camera`` reads it.

    Raises:
        OSError: the file cannot be written.
    """
    (fx, fy), (cx, cy) = calibration.focal, calibration.centre
    written = {
        "image_width": calibration.width,
        "image_height": calibration.height,
        "camera_matrix": [fx, 0, cx, 0, fy, cy, 0, 0, 1],
        "distortion_model": calibration.model,
        "distortion_coefficients": calibration.distortion,
    }
    path.write_text(json.dumps(written))  # which is YAML, too


def _parse(written: bytes) -> Mapping[str, Any]:
    """Return the mapping that YAML holds.

    Raises:
        ValueError: it is too long, no YAML, or no mapping.
    """
    if len(written) > _MOST_BYTES:
        raise ValueError(f"more than {_MOST_BYTES} bytes; is it the calibration of a camera?")
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = _Constructor
    try:
        text = written.decode()
        # OpenCV's first line, %YAML:1.0, is not one of YAML, and `topic echo` of ROS ends with ---.
        loaded = next(yaml.load_all(re.sub(r"\A%YAML.*\n", "", text)), None)
    except (YAMLError, ValueError, RecursionError) as error:
        why = str(getattr(error, "problem", None) or error).partition("\n")[0]
        raise ValueError(f"not valid YAML: {why}") from None
    if not isinstance(loaded, dict):
        raise ValueError("holds no keys; give a camera_info of ROS, or a file of OpenCV")
    return loaded


def calibration_of(given: Mapping[str, Any]) -> Calibration:
    """Return the calibration that the keys of a file, or the fields of a message, say.

    Raises:
        ValueError: it is none; the reason begins with the key.
    """
    width, height = _size(given)
    matrix = _numbers(given, _MATRIX)
    if not any(matrix):
        raise ValueError(f"{_key(given, _MATRIX)}: is 0: this camera has not been calibrated")
    _check_whole(given, width, height)
    if len(matrix) != 9 or matrix[1] or matrix[3] or matrix[6:] != (0, 0, 1):
        raise ValueError(
            f"{_key(given, _MATRIX)}: has to be fx, 0, cx, 0, fy, cy, 0, 0, 1, in 3 rows"
        )
    found = {
        "model": _model(given),
        "width": width,
        "height": height,
        "focal": (matrix[0], matrix[4]),
        "centre": (matrix[2], matrix[5]),
        "distortion": _numbers(given, _DISTORTION),
    }
    try:
        return Calibration.model_validate(found)
    except ValidationError as error:
        first = error.errors()[0]
        field = first["loc"][0] if first["loc"] else "distortion"
        raise ValueError(f"{_key(given, _NAMES[str(field)])}: {first['msg']}") from None


def _check_whole(given: Mapping[str, Any], width: object, height: object) -> None:
    """Refuse the camera of images that are a part of the calibrated ones; raises ValueError."""
    roi = given.get("roi")
    if not isinstance(roi, Mapping):
        return
    part = roi.get("width", 0), roi.get("height", 0)
    if part not in ((0, 0), (width, height)):
        raise ValueError(
            f"roi: the images are a part of {part[0]}×{part[1]} of the calibrated {width}×{height},"
            " which is not supported; record whole images"
        )


def _model(given: Mapping[str, Any]) -> str:
    named = next((given[key] for key in _MODEL if key in given), None)
    if named is None:
        flag = next((given[key] for key in _FISHEYE if key in given), 0)
        return "fisheye" if flag not in (0, "0", False) else "pinhole"
    if str(named) not in _MODELS:
        key = _key(given, _MODEL)
        raise ValueError(f"{key}: {str(named)[:40]!r}; give {', '.join(_MODELS)}")
    return _MODELS[str(named)]


def _size(given: Mapping[str, Any]) -> tuple[Any, Any]:
    if any(key in given for key in _SIZE):
        size = _numbers(given, _SIZE)
        if len(size) != 2:
            raise ValueError(f"{_key(given, _SIZE)}: has to be width and height")
        return int(size[0]), int(size[1])
    return given[_key(given, _WIDTH)], given[_key(given, _HEIGHT)]


def _numbers(given: Mapping[str, Any], names: tuple[str, ...]) -> tuple[float, ...]:
    """Return a matrix or a list, row by row."""
    key = _key(given, names)
    values = given[key]
    if isinstance(values, dict):
        values = values.get("data")
    if not isinstance(values, list):
        raise ValueError(f"{key}: has to be a matrix, with its numbers in 'data', or a list")
    flat = [each for row in values for each in (row if isinstance(row, list) else [row])]
    try:
        return tuple(float(each) for each in flat)
    except (TypeError, ValueError):
        raise ValueError(f"{key}: has to hold numbers") from None


def _key(given: Mapping[str, Any], names: tuple[str, ...]) -> str:
    """Return which of some names a file has."""
    for name in names:
        if name in given:
            return name
    raise ValueError(f"{names[0]}: missing")
