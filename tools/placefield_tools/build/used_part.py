"""What of the images a new map uses: the view of its camera, and what a mask does not hide."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

from placefield.errors import ConfigError
from placefield.features.calibration import View
from placefield.features.extract import Feature
from placefield.features.mask import Mask
from placefield.features.rectification import view_of
from placefield.maps.map import Map
from placefield_tools.build.mask_from_source import mask_of
from placefield_tools.sources import Parts, Source
from placefield_tools.sources.calibration_files import calibration_in


@dataclass(frozen=True)
class UsedPart:
    """What of the images a map uses.

    Attributes:
        view: that they are rectified to; None: they are used as they are.
        mask: hides a part of the rectified image; None: nothing is hidden.
    """

    view: View | None = None
    mask: Mask | None = None

    def of(self, feature: Feature) -> Feature:
        """Return a feature of this part of the images."""
        return replace(feature, view=self.view, mask=self.mask)

    def in_map(self, built: Map) -> Map:
        """Return a map that was built of this part of the images, with the part."""
        return replace(built, model=replace(built.model, view=self.view, mask=self.mask))


WHOLE = UsedPart()


@dataclass(frozen=True)
class AskedPart:
    """What of the images a user asks a map to use.

    Attributes:
        mask: an image whose black part is not used, or ``auto``, see ``mask_of``; None: all is
            used.
        query_cameras: files of other cameras that will drive the route, or recordings, see
            ``calibration_in``: the view is what all see.
    """

    mask: str | None = None
    query_cameras: Sequence[Path] = ()

    def found(self, parts: Parts, first: Callable[[], Source]) -> UsedPart:
        """Return the part, whose mask is of the rectified images of the first source.

        Args:
            parts: say the camera of the frames.
            first: opens the first source.

        Raises:
            ConfigError: a file is refused, see ``calibration_in``, ``view_of`` and ``mask_of``, or
                there are other cameras, and the one of the frames is not known.
            SourceError: the source fails.
        """
        view = self.view(parts)
        mask = None if self.mask is None else mask_of(self.mask, first(), view)
        return UsedPart(view, mask)

    def view(self, parts: Parts) -> View | None:
        """Return the view that all cameras see; None if that of the frames is not known.

        Raises:
            ConfigError: see ``found``.
            SourceError: a recording is refused.
        """
        if parts.camera is None:
            if self.query_cameras:
                raise ConfigError("--query-camera: needs the frames' own camera; give --camera")
            return None
        cameras = (parts.camera, *self.query_cameras)
        return reduce(View.common, (_view_in(camera, parts.topic) for camera in cameras))


ALL_ASKED = AskedPart()


def _view_in(camera: Path, images: str | None) -> View:
    """Return the view that a camera fills, see ``calibration_in`` and ``view_of``.

    Raises:
        ConfigError: the file is refused, or the camera has no view.
        SourceError: the recording is refused.
    """
    calibration = calibration_in(camera, images)
    try:
        return view_of(calibration)
    except ConfigError as error:
        raise ConfigError(f"{camera}: {error}") from None
