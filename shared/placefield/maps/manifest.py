"""What ``manifest.json`` of a map holds."""

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from placefield.config import FeatureConfig, MetricConfig, ScaleConfig
from placefield.errors import MapError
from placefield.features.calibration import View
from placefield.features.network import NetworkInput
from placefield.maps.array_files import open_inside
from placefield.maps.digest import DIGEST_LENGTH, lineage_of, short_digest
from placefield.presets import Preset

SUFFIX = ".pfmap"
"""The suffix of a map's folder."""

MANIFEST = "manifest.json"
"""The manifest's file in a map's folder."""

SEAL = "manifest.sha256"
"""The file that holds the manifest's checksum."""

LONGEST_MANIFEST = 2**20
"""The longest manifest that is read, bytes; one of thousands of channels is shorter."""

MOST_PLACES = 10**7
"""The most places of a map: ten times the largest map that was measured."""

REBUILD = "build the map again with 'placefield build'"
"""The remedy in an error about a map that is refused."""

LeastSide = Annotated[int, Field(ge=1, le=2**16)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


def printable(name: str) -> str:
    """Return a name with escapes for what cannot be printed, such as line ends or control codes.

    A file's name may have them, or an untrusted host's map. A printable name stays as it is.
    """
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in name)


Name = Annotated[str, AfterValidator(printable)]

AlignedBy = Literal["smoother", "poses", "number"]
"""The method that aligned the frames of a drive; with ``number``, frame i shows place i."""


def _kept_all_unless_told(metric: Any) -> Any:
    """Return the settings of a metric; a map that does not say what it kept has kept everything."""
    return {"kept": 1.0, **metric} if isinstance(metric, dict) else metric


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TraverseRecord(_Record):
    """One reference traverse.

    Attributes:
        name: for a person.
        frames: the number of its frames.
        aligned: the number of frames that show a place of the map; None if each frame is a place.
        by: the method of the alignment; None likewise.
        content: checksum of the raw features of its frames; None in a map of an earlier version.
    """

    name: Name
    frames: int = Field(ge=0)
    aligned: int | None = Field(None, ge=0)
    by: AlignedBy | None = None
    content: Sha256 | None = None

    def is_named(self, name: str) -> bool:
        """Return whether this is its name, with or without a slash at the end."""
        return self.name.rstrip("/") == printable(name).rstrip("/")


class ChangeRecord(_Record):
    """One change of a map after it was built.

    Attributes:
        change: what was done with the drive.
        drive: the name of the traverse.
        before: the digest of the map before the change.
    """

    change: Literal["added", "dropped"]
    drive: Name
    before: str = Field(pattern=rf"^[0-9a-f]{{{DIGEST_LENGTH}}}$")


class RouteRecord(_Record):
    """One route of a map of several.

    Attributes:
        name: for a person.
        places: the number of its places.
    """

    name: Name
    places: int = Field(ge=1, le=MOST_PLACES)


class PartRecord(_Record):
    """One part of a feature of several.

    Attributes:
        variance_kept: fraction of the part's variance that its descriptors keep.
        network: input of the network that gives the part; none if no network does.
        least_side: see ``Manifest``.
    """

    variance_kept: float = Field(ge=0, le=1)
    network: NetworkInput | None = None
    least_side: LeastSide | None = None


class MetricRecord(_Record):
    """One metric.

    Attributes:
        learned: whether the projection was learned.
        unit: quantization step of the places' descriptors.
        coarse_unit: quantization step of the coarse search, in units; none if the map has no coarse
            search.
        looks: the number of looks, further descriptors of the places.
    """

    learned: bool
    unit: float = Field(gt=0, allow_inf_nan=False)
    coarse_unit: float | None = Field(None, gt=0, allow_inf_nan=False)
    looks: int = Field(0, ge=0)


class ChannelRecord(_Record):
    """One channel.

    Attributes:
        fuzzifier: m of its fuzzy c-means.
        clusters: the number of clusters.
        metric: the number of its metric.
        refusal: why no metric was learned; empty if one was, or if the map does not say.
    """

    fuzzifier: float
    clusters: int
    metric: int = Field(ge=0)
    refusal: str = ""


class Manifest(_Record):
    """The description of a map: how it was built, and the checksum of each file.

    Attributes:
        format: version of the map format.
        placefield: version of the program that built the map.
        preset: the preset of the build, if one was used.
        model: fingerprint of the descriptor model.
        variance_kept: fraction of the features' variance that the descriptors keep.
        network: input of the network that gives the features; none if no network does.
        least_side: pixels that the shorter side of an image has at least if it is decoded to a part
            of its size; none if images are decoded whole.
        parts: the parts of a feature of several, in their order; none if there is one.
        view: that images are rectified to; none if they are used as they are.
        smallest_scale: smallest scale of all channels, frames.
        pose_frame: name of the coordinate frame of the poses; none if there are no poses.
        history: the changes since the map was built, in their order.
        routes: the routes whose places follow each other; none if there is one route.
        links: the number of links between places, see ``placefield.maps.route_graph``.
        local_features: the number of local features of all places.
        files: checksum of each array's file, by its path in the map; see ``checksum_of``.
    """

    format: Literal[5] = 5
    placefield: str
    preset: Preset | None
    seed: int
    features: FeatureConfig
    scales: ScaleConfig
    metric: Annotated[MetricConfig, BeforeValidator(_kept_all_unless_told)]
    model: str
    variance_kept: float = Field(ge=0, le=1)
    network: NetworkInput | None = None
    least_side: LeastSide | None = None
    parts: tuple[PartRecord, ...] = ()
    view: View | None = None
    places: int = Field(ge=1, le=MOST_PLACES)
    smallest_scale: int = Field(ge=1)
    pose_frame: str | None
    traverses: tuple[TraverseRecord, ...] = Field(min_length=1)
    history: tuple[ChangeRecord, ...] = ()
    routes: tuple[RouteRecord, ...] = ()
    links: int = Field(0, ge=0)
    local_features: int = Field(0, ge=0)
    metrics: tuple[MetricRecord, ...] = Field(min_length=1)
    channels: tuple[ChannelRecord, ...] = Field(min_length=1)
    files: dict[str, Sha256]

    @property
    def lineage(self) -> str:
        """The lineage of the map, see ``lineage_of``."""
        return lineage_of(self.model, len(self.channels))


def check_map_path(path: Path) -> None:
    """Refuse a path that a map cannot be saved to, before the map is built.

    Raises:
        MapError: the path does not end in ``.pfmap``, or holds something that is no map.
    """
    if path.suffix != SUFFIX:
        raise MapError(f"{path}: a map's name ends in {SUFFIX}")
    if path.exists() and not (path / MANIFEST).is_file():
        raise MapError(f"{path}: exists and is no map; remove it or choose another name")


def seal_of(written: bytes) -> bytes:
    """Return the content of ``SEAL`` for a manifest's bytes, as sha256sum writes it.

    It is the checksum of the bytes, because their parsed form may change with the program.
    """
    return f"{hashlib.sha256(written).hexdigest()}  {MANIFEST}\n".encode()


def parse_manifest(written: bytes, source: str) -> Manifest:
    """Parse a manifest's bytes; an error begins with ``source``.

    Raises:
        MapError: it is malformed, or of another format.
    """
    try:
        return Manifest.model_validate_json(written)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole"
        if not key.isprintable():  # an untrusted host may have written the key
            key = ascii(key)
        raise MapError(f"{source}: {key:.80}: {first['msg']}; {REBUILD}") from None


def read_manifest(path: Path) -> Manifest:
    """Read a map's manifest.

    Raises:
        MapError: it is missing, too long, damaged or of another format.
    """
    return read_identified(path)[0]


def read_identified(path: Path, lineage: str | None = None) -> tuple[Manifest, str]:
    """Read a map's manifest and return it with the map's digest, see ``short_digest``.

    Args:
        path: of the map.
        lineage: the lineage that the map must have; None accepts any map.

    Raises:
        MapError: it is missing, too long, damaged, of another format or lineage.
    """
    try:
        written = _read(path, MANIFEST)
    except OSError:
        raise MapError(f"{path}: no map there; make one with 'placefield build'") from None
    manifest = parse_manifest(written, str(path / MANIFEST))
    try:
        seal = _read(path, SEAL)
    except OSError:
        raise MapError(f"{path / SEAL}: missing or unreadable; {REBUILD}") from None
    if seal != seal_of(written):
        raise MapError(f"{path / MANIFEST}: damaged: its checksum is wrong; {REBUILD}")
    if lineage not in (None, manifest.lineage):
        raise MapError(
            f"{path}: is no version of the served map: its descriptor model or its number of "
            "channels differs; put that map back, or start all services again with the new map"
        )
    return manifest, short_digest(written)


def _read(path: Path, name: str) -> bytes:
    with open_inside(path, name) as opened:
        written = opened.read(LONGEST_MANIFEST + 1)
    if len(written) > LONGEST_MANIFEST:
        raise MapError(f"{path / name}: more than {LONGEST_MANIFEST} bytes; {REBUILD}")
    return written
