"""The map in memory."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from placefield.config import FeatureConfig, MetricConfig, ScaleConfig
from placefield.features.descriptors import DescriptorModel
from placefield.maps.digest import NO_DIGEST
from placefield.maps.manifest import TraverseRecord
from placefield.notebook import html_of_map
from placefield.pose import Pose
from placefield.presets import Preset
from placefield.search.coarse import Coarse
from placefield.search.quantized import Codes

Array = NDArray[np.float32]

STEPS = 6
"""Places between those whose distances a map keeps: a vehicle may go as many per frame."""


@dataclass(frozen=True)
class Places:
    """The K places of a map: the frames of its first reference traverse.

    Attributes:
        stamps: (K,) int64, nanoseconds, as the source had them.
        poses: (K, 3) float64, x and y in metres and yaw in radians, NaN where nobody knows; (0, 3)
            if there are none.
        travelled: (K,) float64, metres from the first place to each, not descending; (0,) if nobody
            knows.
        same: (K,) int32, the earliest place that each shows the same stretch as, itself if none:
            see ``placefield.matching.revisits``.
        thumbnails: (bytes,) uint8, JPEG images one after another.
        thumbnail_ends: (K,) int64, where each of them ends.
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

    def pose(self, place: int) -> Pose | None:
        """Return the pose of a place; None if nobody knows it."""
        if not len(self.poses) or not np.isfinite(self.poses[place]).all():
            return None
        return Pose(*map(float, self.poses[place]))

    def thumbnail(self, place: int) -> bytes:
        """Return the thumbnail of a place, JPEG."""
        start = self.thumbnail_ends[place - 1] if place else 0
        return self.thumbnails[start : self.thumbnail_ends[place]].tobytes()


@dataclass(frozen=True, eq=False)
class MapAlignment:
    """How a reference traverse of F frames was aligned to the first.

    Attributes:
        places: (F,) int32, the place that each frame shows, -1 where it was left out.
    """

    places: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class MapMetric:
    """A metric, and the K places under it.

    Attributes:
        learned: whether the projection was learned; else it is the identity.
        projection: (M, N) float32, v of Eq. 6.
        unit: length of one code, see ``placefield.search.quantized``.
        places: (K, M) int16, the codes of the places under it.
        squares: (K,) int32, their squared lengths.
        steps: (6, K) float32, how far each place is from the one before it, the second before it,
            and so on; where there is none, the mean.
        coarse: a coarse look at them, where the map was built for that.
    """

    learned: bool
    projection: Array
    unit: float
    places: Codes
    squares: NDArray[np.int32]
    steps: Array
    coarse: Coarse | None = None

    def __repr__(self) -> str:
        kind = "learned" if self.learned else "identity"
        count, dimensions = self.places.shape
        return f"MapMetric({kind}, {dimensions} dimensions, {count} places)"


@dataclass(frozen=True)
class MapChannel:
    """One channel of a map with K places.

    Attributes:
        fuzzifier: m of its fuzzy c-means.
        clusters: C.
        metric: its metric; channels for which none was learned share one.
        labels: (K,) int32, 0 where the place is inactive, else the number of its segment, from 1.
        segments: (S, 2) int32, first place and last + 1 of every active segment.
        scales: (n,) int32, ascending distinct lengths of the segments, frames.
        smallest: s_min of Eqs. 13 to 16, frames: one for all channels of a map, set beforehand.
        curve: (steps + 1, 2) float64, validation loss and gate score while learning.
        refusal: why no metric was learned for it; empty where one was.
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
    """Nobody else can change what lies in this process's own memory."""


@dataclass(frozen=True)
class Map:
    """All that recognising places on a route needs, and how it was made.

    Attributes:
        preset: by which it was made, for the record; its settings are below.
        alignments: how each traverse but the first was aligned to it, by its number.
        digest: which map it is, 16 hexadecimal digits; see ``placefield.maps.manifest``.
        check_unchanged: raises ``MapError`` when a file that arrays are mapped from was written to
            since the map was opened; what was worked out of it in the meantime may be wrong.
    """

    preset: Preset | None
    seed: int
    features: FeatureConfig
    scales: ScaleConfig
    metric: MetricConfig
    traverses: tuple[TraverseRecord, ...]
    pose_frame: str | None
    model: DescriptorModel
    places: Places
    channels: Sequence[MapChannel]
    alignments: Mapping[int, MapAlignment] = field(default_factory=dict)
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
        """Whether it was opened from disk, so that its digest says which map it is."""
        return self.digest != NO_DIGEST

    @property
    def metrics(self) -> tuple[MapMetric, ...]:
        """The metrics of its channels, each once."""
        return tuple(dict.fromkeys(channel.metric for channel in self.channels))


def fingerprint(model: DescriptorModel) -> str:
    """Return what tells descriptors of one model from those of another, 16 hexadecimal digits."""
    digest = hashlib.sha256(f"{model.kind} {model.standardise} {model.plain}".encode())
    for array in (model.mean, model.deviation, model.components):
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).data)
    if model.network is not None:
        digest.update(model.network.digest)
    return digest.hexdigest()[:16]
