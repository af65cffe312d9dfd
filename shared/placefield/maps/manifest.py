"""What ``manifest.json`` of a map holds."""

import hashlib
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from placefield.config import FeatureConfig, MetricConfig, ScaleConfig
from placefield.features.network import NetworkInput

SUFFIX = ".pfmap"
"""Of a map's folder."""

MANIFEST = "manifest.json"
"""Its file in there."""

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TraverseRecord(_Record):
    """One reference traverse: its name for a person, and how many frames it had."""

    name: str
    frames: int


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
    """One channel: its fuzzifier, its clusters, and the number of its metric."""

    fuzzifier: float
    clusters: int
    metric: int = Field(ge=0)


class Manifest(_Record):
    """The map in words: what it was made of and how, and the checksum of every file.

    Attributes:
        format: version of the map format.
        placefield: version of the program that built it.
        model: fingerprint of the descriptor model.
        network: what the network takes that the features are of; none if they are of none.
        pose_frame: name of the frame that the poses are in; none if there are none.
        files: SHA-256 of each file, by its path in the map.
        checksum: SHA-256 of all the rest; see ``sealed``.
    """

    format: Literal[2] = 2
    placefield: str
    seed: int
    features: FeatureConfig
    scales: ScaleConfig
    metric: MetricConfig
    model: str
    network: NetworkInput | None = None
    places: int = Field(ge=1)
    pose_frame: str | None
    traverses: tuple[TraverseRecord, ...]
    metrics: tuple[MetricRecord, ...] = Field(min_length=1)
    channels: tuple[ChannelRecord, ...] = Field(min_length=1)
    files: dict[str, Sha256]
    checksum: str = ""

    def sealed(self) -> Self:
        """Return the manifest with its checksum."""
        rest = self.model_dump_json(exclude={"checksum"})
        return self.model_copy(update={"checksum": hashlib.sha256(rest.encode()).hexdigest()})
