"""The vehicle's odometry, received from the bus."""

import math

from placefield.bus.keys import Keys
from placefield.bus.messages import OdometryMessage
from placefield.bus.session import Bus
from placefield.errors import MessageError


class Odometry:
    """The metres travelled that the vehicle reported last; they never descend."""

    def __init__(self) -> None:
        # Metres before the last restart of the vehicle count, and the count since. One tuple,
        # because the bus's thread writes it while another thread reads it.
        self._travelled: tuple[float, float] | None = None
        self._returned: tuple[float, float] | None = None

    def listen(self, bus: Bus, keys: Keys) -> None:
        """Receive the odometry of a run from now on."""

        def receive(key: str, payload: bytes) -> None:
            try:
                self._update(OdometryMessage.decode(payload).metres)
            except MessageError as error:
                bus.log_dropped(key, error)

        bus.subscribe_raw(keys.odometry, receive)

    def _update(self, metres: float) -> None:
        before_m, last_m = self._travelled or (0.0, 0.0)
        if metres < last_m:
            before_m += last_m
        if math.isinf(before_m + metres):
            raise MessageError("odometry: the metres overflow")
        self._travelled = before_m, metres

    def metres(self) -> float | None:
        """Return the metres travelled so far; None if there was no report since the last call.

        So a vehicle without odometry is not taken for a stationary one.
        """
        travelled = self._travelled
        is_new, self._returned = travelled is not self._returned, travelled
        return sum(travelled) if travelled is not None and is_new else None
