"""Adding a drive to a map from its source of frames."""

from placefield.errors import SourceError
from placefield.features.extract import feature_of_model
from placefield.maps.adding import Addition, add_traverse, check_content, check_name
from placefield.maps.map import Map
from placefield.verification.extractor import extractor_of_places
from placefield_tools.build.references import describe_reference
from placefield_tools.sources import Parts, open_source
from placefield_tools.sources.frame_content import check_frames, check_view, dimensions_of
from placefield_tools.sources.secrets import without_secrets


def add_drive(
    opened: Map,
    drive: str,
    name: str,
    *,
    spacing_m: float | None,
    parts: Parts,
    leave_out_bad: bool,
) -> Addition:
    """Add a drive to a map, showing progress.

    Args:
        opened: the map, with all its channels.
        drive: a source of frames.
        name: of the drive in the map.
        spacing_m: metres between the frames, by odometry; None: every frame.
        parts: selects topics and frames.
        leave_out_bad: add the drive without frames that are missing or cannot be read.

    Raises:
        SourceError: the source or one of its frames cannot be read, it is a camera, or its frames
            are not what the map takes.
        MapError: the map has this drive; or see ``add_traverse``.
        ConfigError: a network of the map cannot run.
    """
    check_name(opened, name)
    known = opened.local_features
    with open_source((drive,), spacing_m=spacing_m, parts=parts) as source:
        if source.live:
            shown = without_secrets(drive)
            raise SourceError(f"{shown}: no live camera is added; record a drive and add that")
        check_frames(source, drive, dimensions_of(opened.model), "the map")
        check_view(source, drive, opened.model.view)
        described = describe_reference(
            source,
            name,
            feature_of_model(opened.model),
            leave_out_bad=leave_out_bad,
            extractor=None if known is None else extractor_of_places(known),
        )
    check_content(opened, name, described.content)
    return add_traverse(opened, described.traverse())
