"""What services serve: a map, or while a drive is explored what stands for the map."""

from collections.abc import Callable, Sized
from typing import NamedTuple, Protocol

from placefield.fusion.fusion_stage import AnyFusionStage


class Served(Protocol):
    """What a featurizer and a fuser need of the map that they serve."""

    @property
    def digest(self) -> str:
        """Identifies it, 16 hexadecimal digits."""

    @property
    def channels(self) -> Sized:
        """Its channels."""

    @property
    def check_unchanged(self) -> Callable[[], None]:
        """Raises ``MapError`` if its files were written to."""


class FuserVersion(NamedTuple):
    """A version of the map, as a fuser serves it, and the stage that fuses its candidates."""

    served: Served
    stage: AnyFusionStage
