"""The configuration of a run: one frozen value."""

from typing import Annotated, Literal

import tomli_w
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
)
from pydantic_core import PydanticCustomError
from pydantic_settings import NoDecode

from placefield.errors import ConfigError
from placefield.features.kinds import FeatureKind, LocalFeatureKind
from placefield.metric.push import Push
from placefield.presets import Preset


def _split(names: object) -> object:
    """Split names that a flag or the environment gives as one text."""
    return tuple(names.split(",")) if isinstance(names, str) else names


def _check_distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise PydanticCustomError("distinct", "give each name once")
    return names


RunName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]+$")]
RunNames = Annotated[
    tuple[RunName, ...],
    NoDecode,
    BeforeValidator(_split),
    AfterValidator(_check_distinct),
    Field(min_length=1),
]
Endpoints = Annotated[tuple[str, ...], NoDecode, BeforeValidator(_split)]
MetricKind = Literal["lmnn", "rca", "lfda", "nca", "identity"]
Solver = Literal["placefield", "metric-learn"]
Fuzzifiers = tuple[Annotated[float, Field(gt=1)], Annotated[float, Field(gt=1)]]
Rule = Literal["filter", "evidence", "ams"]
Provider = Literal["cpu", "cuda", "openvino", "coreml"]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class BusConfig(_Section):
    """The connection to the bus."""

    endpoint: str = Field("tcp/127.0.0.1:7557", description="the router: PROTOCOL/HOST:PORT")
    credentials: str | None = Field(
        None,
        description="folder of one role's files, for tls/HOST:PORT; see 'placefield security init'",
    )
    connect: Endpoints = Field(
        (),
        description="routers of other hosts that this host's router connects to, comma-separated",
    )
    connect_timeout_s: float = Field(10.0, gt=0, description="seconds that a service waits for it")


class FeatureConfig(_Section):
    """How a frame becomes a descriptor."""

    kind: FeatureKind = Field(
        "gist",
        description="grayscale, gist, onnx:FILE (a network), or a feature of another package; "
        "several as gist+onnx:FILE; descriptor: the frames are descriptors",
    )
    dimensions: int | None = Field(
        None,
        ge=1,
        description="dimensions of the descriptor of each feature, after PCA; default 300, 500 for "
        "grayscale",
    )
    standardise: bool = Field(
        True, description="standardise features by the query's running mean and deviation"
    )
    plain_pca: bool = Field(
        False,
        description="PCA of raw features, not standardised, not of unit length; true: the paper",
    )

    def serve(self, rule: Rule) -> bool:
        """Return whether a rule can use such descriptors.

        The constants of ``filter`` are for descriptors of unit length, not for those of plain PCA.
        """
        return rule != "filter" or not self.plain_pca

    def check_rule(self, rule: Rule) -> None:
        """Refuse a rule that cannot use such descriptors.

        Raises:
            ConfigError: the rule cannot use them.
        """
        if not self.serve(rule):
            raise ConfigError(
                "rule filter: does not follow descriptors of plain PCA (features.plain_pca), as "
                "this map has: give --preset paper"
            )


class InferenceConfig(_Section):
    """Where a process runs a network."""

    provider: Provider = Field(
        "cpu", description="of onnxruntime: cpu, cuda, openvino or coreml; see 'placefield doctor'"
    )
    threads: int = Field(1, ge=1, le=1024, description="threads of each process on the cpu")


class ScaleConfig(_Section):
    """How the reference traverse is cut into segments."""

    channels: int = Field(4, ge=1, le=64, description="clusterings, each with its own fuzzifier")
    clusters: int | None = Field(
        None, ge=2, description="clusters per channel; estimated by default"
    )
    position_weight: float = Field(
        1.0, ge=0, description="weight of the position in the route when clustering; 0: the paper"
    )
    fuzzifiers: Fuzzifiers = Field(
        (1.02, 1.4),
        description="fuzzifiers of the first and of the last channel; the others lie between",
    )
    same_start: bool = Field(
        False,
        description="all channels start clustering from the same stretches; true: the paper",
    )
    min_scale: int = Field(
        4, ge=2, description="shortest active segment, frames; ams: its smallest scale"
    )
    min_scale_metres: float = Field(
        0.0, ge=0, description="the same in metres, if the reference has poses; 0: in frames"
    )


class MetricConfig(_Section):
    """How a channel's metric is learned."""

    kind: MetricKind = Field("lmnn", description="lmnn, rca, lfda, nca or identity")
    neighbours: int = Field(
        3, ge=1, description="lmnn: target neighbours of a frame (k); lfda: its k"
    )
    push: Push = Field(
        0.5,
        description="fraction of lmnn's push term; the paper's λ: push / (1 - push); "
        "cross-validation chooses it",
    )
    steps: int = Field(30, ge=1, description="most steps of lmnn or nca")
    solver: Solver = Field(
        "placefield",
        description="whose lmnn: placefield's, or metric-learn's, which is slower",
    )
    kept: float = Field(
        0.99,
        gt=0,
        le=1,
        description="part of the squared distances between segments that a learned metric keeps, "
        "in as few dimensions as it takes; 1: the paper",
    )
    gate: bool = Field(
        True,
        description="keep a metric only if it recognises another traverse better; false: the paper",
    )

    @property
    def push_share(self) -> float:
        """The push as a number, also if cross-validation was to choose it and has done so.

        Raises:
            ConfigError: cross-validation has not chosen it yet.
        """
        if isinstance(self.push, str):
            raise ConfigError(f"metric.push: {self.push} has not been done; give a fraction")
        return self.push


class BuildConfig(_Section):
    """How a map is built for the search of places."""

    coarse_from: int = Field(
        200_000,
        ge=1,
        description="a map of so many places or more is built with an index, and matched by it",
    )
    looks: bool = Field(
        False,
        description="a map of several traverses keeps each one's descriptors of the places, and a "
        "frame is compared with the nearest",
    )
    local_features: int = Field(
        0,
        ge=0,
        le=2000,
        description="local features that the map keeps of each place, to verify matches, of 136 "
        "bytes each; 300 to 600 are enough; 0: none",
    )
    local_feature: LocalFeatureKind = Field(
        "sift", description="what gives local features: sift, or onnx:FILE, a network"
    )


class MatchingConfig(_Section):
    """How candidates are made and fused."""

    rule: Rule = Field("filter", description="how candidates are made and fused")
    tolerance: int = Field(
        3,
        ge=0,
        le=10**12,
        description="places within which a match is right; filter: its probability is of that",
    )
    precision: float = Field(
        0.99, gt=0, lt=1, description="filter: a match of at least this probability is known"
    )
    lag: int = Field(20, ge=0, le=1000, description="most frames that a smoothed match waits for")
    neighbourhood: int = Field(
        10, ge=0, description="evidence: places on either side that the margin ignores"
    )
    reverse: bool = Field(False, description="the vehicle travels the route in reverse")
    exact: bool = Field(
        False,
        description="filter: compare exactly with every place, even if the map has a coarse index",
    )

    @property
    def compares_exactly(self) -> bool:
        """Whether frames are compared exactly with every place, without a coarse search."""
        return self.exact or self.rule != "filter"


class FusionConfig(_Section):
    """The fuser's deadline."""

    deadline_s: float = Field(
        2.0, gt=0, description="how long the fuser waits for the candidates of one frame"
    )


class VerificationConfig(_Section):
    """How matches are verified by geometry."""

    least_probability: float = Field(
        0.1, ge=0, le=1, description="matches of a lower probability are not verified"
    )
    focal: float | None = Field(
        None,
        gt=0,
        description="focal length of the camera, as a fraction of the image's longest side, if "
        "there is no --camera; without both there are no relative poses",
    )


class MonitoringConfig(_Section):
    """The address at which a service answers Prometheus."""

    port: int | None = Field(
        None, ge=1, le=65535, description="port of the metrics; none by default"
    )
    host: str = Field(
        "127.0.0.1", description="address of the metrics; 0.0.0.0: all of this host's networks"
    )


class Config(_Section):
    """The configuration of a run, or of several runs on one map."""

    runs: RunNames = Field(("default",), description="names of the runs, separated by commas")
    preset: Preset | None = Field(
        None, description="defaults for many settings at once; paper: as published"
    )
    seed: int = Field(0, ge=0, description="seed of everything random")
    bus: BusConfig = BusConfig()
    features: FeatureConfig = FeatureConfig()
    inference: InferenceConfig = InferenceConfig()
    scales: ScaleConfig = ScaleConfig()
    metric: MetricConfig = MetricConfig()
    build: BuildConfig = BuildConfig()
    matching: MatchingConfig = MatchingConfig()
    fusion: FusionConfig = FusionConfig()
    verification: VerificationConfig = VerificationConfig()
    monitoring: MonitoringConfig = MonitoringConfig()

    @property
    def run(self) -> str:
        """The name of the only run.

        Raises:
            ConfigError: there are several.
        """
        if len(self.runs) > 1:
            raise ConfigError(f"runs {', '.join(self.runs)}: give one of them with --run")
        return self.runs[0]

    def to_toml(self) -> str:
        """Return the configuration as TOML; keys without a value are left out."""
        return tomli_w.dumps(self.model_dump(exclude_none=True))
