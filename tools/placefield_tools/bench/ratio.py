"""The ratio of two ways that took turns, with its confidence interval."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.stats import quantile_test

_CONFIDENCE = 0.95
_NARROW = 0.1  # width of an interval over the ratio


@dataclass(frozen=True)
class Ratio:
    """How many times as much as another way one way takes.

    Attributes:
        value: the median over the rounds.
        low: lower end of the 95 % confidence interval of the median, from the order statistics of
            the rounds; NaN with fewer than six rounds, which have no such interval.
        high: upper end, likewise.
    """

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, one: NDArray[np.float64], other: NDArray[np.float64]) -> Self:
        """Compare what two ways took in the same rounds, (rounds,) each."""
        ratios = one / other
        found: Any = quantile_test(ratios, p=0.5)  # scipy's stub has no type for its interval
        low, high = found.confidence_interval(_CONFIDENCE)
        return cls(float(np.median(ratios)), float(low), float(high))

    @property
    def is_narrow(self) -> bool:
        """Whether there is an interval, and it is narrower than 10 % of the ratio."""
        return self.high - self.low < _NARROW * self.value

    def times(self, factor: float) -> Self:
        """Return the ratio if the first way took so many times as much."""
        return replace(
            self, value=factor * self.value, low=factor * self.low, high=factor * self.high
        )
