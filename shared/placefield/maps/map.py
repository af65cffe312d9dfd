"""The map in memory."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from placefield.config import FeatureConfig, MetricConfig, ScaleConfig
from placefield.features.joined_model import AnyModel
from placefield.maps.digest import NO_DIGEST, lineage_of
from placefield.maps.manifest import ChangeRecord, TraverseRecord
from placefield.maps.route_graph import RouteGraph
from placefield.maps.topology import Topology
from placefield.notebook import html_of_map
from placefield.pose import Pose
from placefield.presets import Preset
from placefield.search.coarse import CoarseIndex
from placefield.search.looks import Looks
from placefield.search.quantized import Quantized
from placefield.verification.place_features import PlaceFeatures

Array = NDArray[np.float32]

STEPS = 6
"""A map keeps the distances of places up to this many apart: the most places per frame."""


@dataclass(frozen=True)
class Places:
    """The K places of a map: the frames of its first reference traverse.

    Attributes:
        stamps: (K,) int64, nanoseconds, as the source gave them.
        poses: (K, 3) float64, x and y in metres and yaw in radians, NaN where unknown; (0, 3) if no
            place has a pose.
        travelled: (K,) float64, metres from the first place to each, never descending; (0,) if
            unknown.
        same: (K,) int32, for each place the earliest place that shows the same stretch, or the
            place itself; see ``placefield.matching.revisits``.
        thumbnails: (bytes,) uint8, JPEG images one after another.
        thumbnail_ends: (K,) int64, where each image ends.
    """

    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    travelled: NDArray[np.float64]
    same: NDArray[np.int32]
    thumbnails: NDArray[np.uint8]
    thumbnail_ends: NDArray[np.int64]

    def __repr__(self) -> str:
        posed = "with poses" if len(self.poses) else "no poses"
        return f"Places({self.count}, {posed})"

    @property
    def count(self) -> int:
        """K."""
        return len(self.stamps)

    @property
    def has_thumbnails(self) -> bool:
        """Whether the places have thumbnails; those of a map of descriptors have none."""
        return len(self.thumbnails) > 0

    def pose(self, place: int) -> Pose | None:
        """Return the pose of a place; None if it is unknown."""
        if not len(self.poses) or not np.isfinite(self.poses[place]).all():
            return None
        return Pose(*map(float, self.poses[place]))

    def thumbnail(self, place: int) -> bytes:
        """Return the thumbnail of a place, JPEG; empty if the places have none."""
        start = self.thumbnail_ends[place - 1] if place else 0
        return self.thumbnails[start : self.thumbnail_ends[place]].tobytes()


@dataclass(frozen=True, eq=False)
class MapAlignment:
    """The alignment of a reference traverse of F frames to the first traverse.

    Attributes:
        places: (F,) int32, the place that each frame shows; -1 if the frame was left out.
    """

    places: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class MapMetric:
    """A metric, and the K places under it.

    Attributes:
        learned: whether the projection was learned; if not, it is the identity.
        projection: (M, N) float32, v of Eq. 6.
        unit: quantization step, see ``placefield.search.quantized``.
        places: (K, M) int16, the projected and quantized descriptors of the places.
        squares: (K,) int32, their squared lengths.
        steps: (6, K) float32, the distance of each place to the place before it, to the second
            before it, and so on, along the likeliest way; the mean of the row where there is no
            such place.
        coarse: index of the coarse search; None if the map was built without one.
        looks: further descriptors of the places, of other traverses; None if there are none.
    """

    learned: bool
    projection: Array
    unit: float
    places: Quantized
    squares: NDArray[np.int32]
    steps: Array
    coarse: CoarseIndex | None = None
    looks: Looks | None = None

    def __repr__(self) -> str:
        kind = "learned" if self.learned else "identity"
        count, dimensions = self.places.shape
        return f"MapMetric({kind}, {dimensions} dimensions, {count} places)"


@dataclass(frozen=True)
class MapChannel:
    """One channel of a map with K places.

    Attributes:
        fuzzifier: m of its fuzzy c-means.
        clusters: C, the number of clusters.
        metric: its metric; channels without a learned metric share one.
        labels: (K,) int32, the number of each place's segment, from 1; 0 for an inactive place.
        segments: (S, 2) int32, first place and last place + 1 of each active segment.
        scales: (n,) int32, ascending distinct lengths of the segments, frames.
        smallest: s_min of Eqs. 13 to 16, frames: the same for all channels of a map.
        curve: (steps + 1, 2) float64, validation loss and gate score during learning.
        refusal: why no metric was learned; empty if one was, or if the map does not say.
    """

    fuzzifier: float
    clusters: int
    metric: MapMetric
    labels: NDArray[np.int32]
    segments: NDArray[np.int32]
    scales: NDArray[np.int32]
    smallest: int
    curve: NDArray[np.float64]
    refusal: str = ""

    def __repr__(self) -> str:
        lengths = f"{self.scales[0]} to {self.scales[-1]} frames"
        made = f"{self.clusters} clusters of fuzzifier {self.fuzzifier:g}"
        return f"MapChannel({made}, {len(self.segments)} segments of {lengths}, {self.metric!r})"


def _stays() -> None:
    """Do nothing: other processes cannot change a map in this process's memory."""


@dataclass(frozen=True)
class Map:
    """A built map: everything that place recognition on a route needs, and how it was built.

    Attributes:
        preset: the preset of the build, for the record; the settings are in the fields below.
        graph: the routes of the map and the links between its places.
        alignments: how each traverse but the first was aligned to the places, by traverse number.
        identity: the metric that is not learned, which has the descriptors of the places as they
            are; None in an old map whose channels all learned theirs, and in a map of which only
            some channels were opened.
        history: the drives that were added or dropped since the map was built, in this order.
        local_features: of the places, to verify matches; None if the map was built without.
        digest: identifies the map, 16 hexadecimal digits; see ``placefield.maps.digest``.
        check_unchanged: raises ``MapError`` if a memory-mapped file was written to since the map
            was opened. Results computed in the meantime may be wrong.
    """

    preset: Preset | None
    seed: int
    features: FeatureConfig
    scales: ScaleConfig
    metric: MetricConfig
    traverses: tuple[TraverseRecord, ...]
    pose_frame: str | None
    model: AnyModel
    places: Places
    channels: Sequence[MapChannel]
    graph: RouteGraph = field(default_factory=lambda: RouteGraph.line(""))
    alignments: Mapping[int, MapAlignment] = field(default_factory=dict)
    local_features: PlaceFeatures | None = None
    identity: MapMetric | None = None
    history: tuple[ChangeRecord, ...] = ()
    digest: str = field(default=NO_DIGEST, compare=False)
    check_unchanged: Callable[[], None] = field(default=_stays, compare=False, repr=False)

    def __repr__(self) -> str:
        known = f"{self.digest}, " if self.is_saved else ""
        made = f"{len(self.channels)} channels, {self.features.kind}"
        return f"Map({known}{self.places.count} places of {self.traverses[0].name!r}, {made})"

    def _repr_html_(self) -> str:
        return html_of_map(self)

    @property
    def is_saved(self) -> bool:
        """Whether the map was opened from disk, and so has a digest."""
        return self.digest != NO_DIGEST

    @property
    def lineage(self) -> str:
        """What all versions of the map have in common, see ``lineage_of``."""
        return lineage_of(fingerprint(self.model), len(self.channels))

    @property
    def topology(self) -> Topology:
        """How its places follow each other."""
        return Topology(self.graph, self.places.travelled, self.places.same)

    @property
    def metrics(self) -> tuple[MapMetric, ...]:
        """The distinct metrics: the identity, if the map has it, then those of its channels."""
        own = () if self.identity is None else (self.identity,)
        return tuple(dict.fromkeys((*own, *(channel.metric for channel in self.channels))))


def fingerprint(model: AnyModel) -> str:
    """Return the fingerprint that identifies a descriptor model, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in model.parts:
        digest.update(f"{part.kind} {part.standardise} {part.plain}".encode())
        for array in (part.mean, part.deviation, part.components):
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array).data)
        if part.network is not None:
            digest.update(part.network.digest)
        if part.least_side is not None:
            digest.update(f"least side {part.least_side}".encode())
    if model.mask is not None:
        digest.update(f"mask {model.mask.used.shape}".encode())
        digest.update(np.ascontiguousarray(model.mask.used).data)
    if model.view is not None:
        digest.update(f"view {model.view.half_width!r} {model.view.half_height!r}".encode())
    return digest.hexdigest()[:16]
