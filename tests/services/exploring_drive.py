"""Raw features of a made-up drive with a loop, as messages, and what the library answers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.config import MatchingConfig
from placefield.matching.exploring import Answer, Explorer, SmoothedAnswer

MODEL = "0123456789abcdef"
CONFIG = MatchingConfig(lag=10)
FRAMES = 160


def features() -> list[NDArray[np.float32] | None]:
    """Return the raw features of two laps; some frames were not observed."""
    rng = np.random.default_rng(0)
    views, view = np.zeros((FRAMES // 2, 60)), rng.normal(size=60)
    for place in range(len(views)):
        view = 0.7 * view + rng.normal(size=60)
        views[place] = view
    laps = np.tile(views, (2, 1)) + 10 + rng.normal(scale=0.3, size=(FRAMES, 60))
    raws: list[NDArray[np.float32] | None] = [*laps.astype(np.float32)]
    raws[40] = raws[100] = None
    return raws


def about(sequence: int, *, live: bool = False, oldest: int = 0, end: bool = False) -> Header:
    return Header(
        stream="s",
        sequence=sequence,
        stamp_ns=10 * sequence,
        live=live,
        oldest=min(oldest, sequence),
        end=end,
    )


def message(raw: NDArray[np.float32] | None, model: str = MODEL) -> bytes:
    return FeatureMessage(model=model, descriptor=raw).encode()


def offline(
    raws: Sequence[NDArray[np.float32] | None],
) -> tuple[list[Answer], list[SmoothedAnswer]]:
    explorer = Explorer(CONFIG)
    causal, smoothed = [], []
    for raw in raws:
        causal.append(explorer.update(raw))
        smoothed += explorer.smoothed()
    return causal, smoothed + explorer.finish()
