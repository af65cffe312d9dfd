"""What ``manifest.json`` of a map holds."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from placefield.config import FeatureConfig, MetricConfig, ScaleConfig
from placefield.features.network import NetworkInput

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TraverseRecord(_Record):
    """One reference traverse: its name for a person, and how many frames it had."""

    name: str
    frames: int


class ChannelRecord(_Record):
    """One channel: its fuzzifier, its clusters, and whether its metric passed the gate."""

    fuzzifier: float
    clusters: int
    learned: bool


class Manifest(_Record):
    """The map in words: what it was made of and how, and the checksum of every file.

    Attributes:
        format: version of the map format.
        placefield: version of the program that built it.
        model: fingerprint of the descriptor model.
        network: what the network takes that the features are of; none if they are of none.
        pose_frame: name of the frame that the poses are in; none if there are none.
        files: SHA-256 of each file, by its path in the map.
    """

    format: Literal[1] = 1
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
    channels: tuple[ChannelRecord, ...] = Field(min_length=1)
    files: dict[str, Sha256]
