"""What ``manifest.json`` of a map holds."""

import hashlib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from placefield.config import FeatureConfig, MetricConfig, ScaleConfig
from placefield.errors import MapError
from placefield.features.network import NetworkInput
from placefield.maps.digest import short_digest
from placefield.maps.reading import open_inside
from placefield.presets import Preset

SUFFIX = ".pfmap"
"""Of a map's folder."""

MANIFEST = "manifest.json"
"""Its file in there."""

SEAL = "manifest.sha256"
"""The file beside it that holds its checksum."""

LONGEST_MANIFEST = 2**20
"""Bytes; thousands of channels take less."""

MOST_PLACES = 10**7
"""Of a map: ten times what the method is measured on."""

REBUILD = "build the map again with 'placefield build'"
"""What is to be done about a map that is refused."""

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


AlignedBy = Literal["smoother", "poses", "number"]
"""By what the frames of a drive were aligned: by number, frame i shows place i."""


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TraverseRecord(_Record):
    """One reference traverse.

    Attributes:
        name: for a person.
        frames: how many it had.
        aligned: how many of them show a place of the first; none of the first.
        by: what they were aligned; none of the first.
    """

    name: str
    frames: int = Field(ge=0)
    aligned: int | None = Field(None, ge=0)
    by: AlignedBy | None = None


class MetricRecord(_Record):
    """One metric.

    Attributes:
        learned: whether it was.
        unit: length of one code of its places.
        coarse_unit: the same of the coarse look at them; none where the map is to be searched
            exactly.
    """

    learned: bool
    unit: float = Field(gt=0, allow_inf_nan=False)
    coarse_unit: float | None = Field(None, gt=0, allow_inf_nan=False)


class ChannelRecord(_Record):
    """One channel.

    Attributes:
        fuzzifier: of its clusters.
        clusters: how many.
        metric: number of its metric.
        refusal: why none was learned; empty where one was.
    """

    fuzzifier: float
    clusters: int
    metric: int = Field(ge=0)
    refusal: str = ""


class Manifest(_Record):
    """The map in words: what it was made of and how, and the checksum of every file.

    Attributes:
        format: version of the map format.
        placefield: version of the program that built it.
        preset: by which it was built; none if by none.
        model: fingerprint of the descriptor model.
        variance_kept: share of the features' variance that its descriptors keep.
        network: what the network takes that the features are of; none if they are of none.
        smallest_scale: of all channels, frames.
        pose_frame: name of the frame that the poses are in; none if there are none.
        files: checksum of each array's file, by its path in the map; see ``checksum_of``.
    """

    format: Literal[5] = 5
    placefield: str
    preset: Preset | None
    seed: int
    features: FeatureConfig
    scales: ScaleConfig
    metric: MetricConfig
    model: str
    variance_kept: float = Field(ge=0, le=1)
    network: NetworkInput | None = None
    places: int = Field(ge=1, le=MOST_PLACES)
    smallest_scale: int = Field(ge=1)
    pose_frame: str | None
    traverses: tuple[TraverseRecord, ...]
    metrics: tuple[MetricRecord, ...] = Field(min_length=1)
    channels: tuple[ChannelRecord, ...] = Field(min_length=1)
    files: dict[str, Sha256]


def seal_of(written: bytes) -> bytes:
    """Return what ``SEAL`` holds of a manifest as it is written, in the words of sha256sum.

    It is of the bytes, and not of what they mean: that may change with the program that reads them.
    """
    return f"{hashlib.sha256(written).hexdigest()}  {MANIFEST}\n".encode()


def parse_manifest(written: bytes, source: str) -> Manifest:
    """Read a manifest as it is written; ``source`` says whose it is, should it be refused.

    Raises:
        MapError: it is of another format, or none.
    """
    try:
        return Manifest.model_validate_json(written)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole"
        if not key.isprintable():  # a stranger may have named it
            key = ascii(key)
        raise MapError(f"{source}: {key:.80}: {first['msg']}; {REBUILD}") from None


def read_manifest(path: Path) -> Manifest:
    """Read a map's manifest.

    Raises:
        MapError: there is none, it is of another format, too long or damaged.
    """
    return read_identified(path)[0]


def read_identified(path: Path, digest: str | None = None) -> tuple[Manifest, str]:
    """Read a map's manifest, and which map it is of; see ``short_digest``.

    Args:
        path: of the map.
        digest: of the map that it has to be; None: any.

    Raises:
        MapError: there is none, it is of another format, damaged, or of another map.
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
    found = short_digest(written)
    if digest not in (None, found):
        raise MapError(
            f"{path}: is the map {found} now, not {digest}, which is served: put that one back, or "
            "end all that serves it and start it with this one"
        )
    return manifest, found


def _read(path: Path, name: str) -> bytes:
    with open_inside(path, name) as opened:
        written = opened.read(LONGEST_MANIFEST + 1)
    if len(written) > LONGEST_MANIFEST:
        raise MapError(f"{path / name}: more than {LONGEST_MANIFEST} bytes; {REBUILD}")
    return written
