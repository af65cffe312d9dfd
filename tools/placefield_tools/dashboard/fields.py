"""A channel's answer to a frame along the route: its active segment and its evidence."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import MapChannel
from placefield.matching.candidate import Candidate

_MOST = 400  # places whose evidence is kept, per candidate
_WINDOW = 400  # places drawn at once; segments are about a tenth of that
_STRIDE = 100


@dataclass(frozen=True)
class Window:
    """The range of places that is drawn; ``end`` is exclusive."""

    first: int
    end: int

    @property
    def size(self) -> int:
        """Number of places."""
        return self.end - self.first


def window_around(place: int, count: int) -> Window:
    """Return the window of ``count`` places around a place; it moves in strides, not by place."""
    if count <= _WINDOW:
        return Window(0, count)
    first = (place // _STRIDE) * _STRIDE - (_WINDOW - _STRIDE) // 2
    first = min(max(first, 0), count - _WINDOW)
    return Window(first, first + _WINDOW)


def thinned(candidate: Candidate, rule: Rule) -> Candidate:
    """Return a candidate with the evidence of its best places only."""
    evidence = candidate.evidence
    places = candidate.places
    if rule != "filter":
        places = np.arange(len(evidence), dtype=np.int32)
    if len(evidence) > _MOST:
        ranked = -evidence if rule == "filter" else evidence
        best = np.sort(np.argpartition(ranked, _MOST)[:_MOST])
        places, evidence = places[best], evidence[best]
    return replace(candidate, places=places, evidence=evidence)


def heights(
    candidate: Candidate, rule: Rule | None, window: Window, bins: int
) -> NDArray[np.float64]:
    """Return the evidence of each part of a window, (bins,), 0 to 1.

    Under ``filter`` that is the belief in its best place; under ``evidence`` how far that is from
    the worst to the best of the candidate's places.
    """
    evidence = candidate.evidence.astype(np.float64)
    if rule == "evidence" and len(evidence):
        evidence = (evidence.max() - evidence) / max(np.ptp(evidence), 1e-9)
    inside = (candidate.places >= window.first) & (candidate.places < window.end)
    part = (candidate.places[inside].astype(np.int64) - window.first) * bins // window.size
    found = np.zeros(bins)
    np.maximum.at(found, part, np.clip(evidence[inside], 0, 1))
    return found


def firing_segment(channel: MapChannel, place: int) -> tuple[int, int] | None:
    """Return the first place and the last + 1 of the active segment at a place, if there is one."""
    if not 0 <= place < len(channel.labels) or channel.labels[place] == 0:
        return None
    first, end = channel.segments[channel.labels[place] - 1]
    return int(first), int(end)
