"""What the frames of sources are: images, or descriptors of one dimension."""

import logging

from placefield.config import Config
from placefield.errors import ConfigError, FrameError, SourceError
from placefield.features.calibration import View
from placefield.features.joined_model import AnyModel
from placefield.features.kinds import DESCRIPTOR
from placefield.features.rectification import check_calibrated, seen
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.source import Source

log = logging.getLogger(__name__)


def with_feature_of(source: Source, where: str, config: Config) -> Config:
    """Return the configuration with the kind of feature that the frames of a source have.

    That of images is the configured one, and that of descriptors is ``descriptor``.

    Args:
        source: opened.
        where: its name, used in messages.
        config: its feature is the default, unless the user asked for another.

    Raises:
        SourceError: the frames cannot have the configured feature.
    """
    kind, shown = config.features.kind, without_secrets(where)
    if source.dimensions is None:
        if kind == DESCRIPTOR:
            raise SourceError(f"{shown}: holds images; leave --feature {kind} out")
        return config
    if kind not in (DESCRIPTOR, Config().features.kind):
        raise SourceError(f"{shown}: holds descriptors, which {kind} cannot describe; leave it out")
    features = config.features.model_copy(update={"kind": DESCRIPTOR})
    return config.model_copy(update={"features": features})


def dimensions_of(model: AnyModel) -> int | None:
    """Return the dimension of the descriptors that a map takes; None if it takes images."""
    return model.raw_dimensions if model.kind == DESCRIPTOR else None


def check_frames(source: Source, where: str, dimensions: int | None, other: str) -> None:
    """Refuse a source whose frames cannot be compared with others.

    Args:
        source: opened.
        where: its name, used in messages.
        dimensions: of the others' descriptors; None: they are images.
        other: name of what has the others.

    Raises:
        SourceError: the frames are images and the others descriptors, or the reverse, or they are
            descriptors of another dimension.
    """
    if source.dimensions != dimensions:
        raise SourceError(
            f"{without_secrets(where)}: holds {_content(source.dimensions)}, and {other} has "
            f"{_content(dimensions)}; give frames of one kind"
        )


def check_view(source: Source, where: str, view: View | None) -> None:
    """Refuse a source whose camera does not fit the view of a map.

    A camera that does not see all of the view is logged.

    Args:
        source: opened.
        where: its name, used in messages.
        view: of the map; None: it is of no camera's view.

    Raises:
        SourceError: the source is refused.
    """
    try:
        check_calibrated(source.calibration, view)
    except FrameError as error:
        raise SourceError(f"{without_secrets(where)}: {error}") from None
    if source.calibration is None or view is None:
        return
    share = seen(source.calibration, view)
    if share < 1:
        log.warning(
            "%s: its camera sees %.0f %% of the map's view, and the rest is as the image's border; "
            "build the map with --query-camera",
            without_secrets(where),
            100 * share,
        )


def check_images(source: Source, asked: str) -> None:
    """Refuse what is asked for if it needs images, and the frames of a source are descriptors.

    Args:
        source: opened.
        asked: the flag or setting, used in messages.

    Raises:
        ConfigError: the frames are descriptors.
    """
    if source.dimensions is not None:
        raise ConfigError(f"{asked}: needs images, and the frames are descriptors; leave it out")


def _content(dimensions: int | None) -> str:
    return "images" if dimensions is None else f"descriptors of {dimensions} dimensions"
