"""The vehicle's odometry off the bus."""

import math

from placefield.bus.keys import Keys
from placefield.bus.messages import OdometryMessage
from placefield.bus.session import Bus
from placefield.errors import MessageError


class Odometry:
    """Metres travelled, as the vehicle last said; never going down."""

    def __init__(self) -> None:
        # What was travelled before the last restart of the vehicle's own count, and that count: one
        # value, for the bus's thread writes while another reads.
        self._travelled: tuple[float, float] | None = None
        self._told: tuple[float, float] | None = None

    def listen(self, bus: Bus, keys: Keys) -> None:
        """Take what comes on a run's key from now on."""

        def receive(key: str, payload: bytes) -> None:
            try:
                self._take(OdometryMessage.decode(payload).metres)
            except MessageError as error:
                bus.log_dropped(key, error)

        bus.subscribe_raw(keys.odometry, receive)

    def _take(self, metres: float) -> None:
        before_m, last_m = self._travelled or (0.0, 0.0)
        if metres < last_m:
            before_m += last_m
        if math.isinf(before_m + metres):
            raise MessageError("odometry: more metres than can be counted")
        self._travelled = before_m, metres

    def metres(self) -> float | None:
        """Return the metres travelled so far; None if nothing was said since this was last asked.

        For a vehicle whose odometry has stopped coming must not look like one that stands still.
        """
        travelled = self._travelled
        is_news, self._told = travelled is not self._told, travelled
        return sum(travelled) if travelled is not None and is_news else None
