"""The vehicle's odometry off the bus."""

from placefield.bus.keys import Keys
from placefield.bus.messages import OdometryMessage
from placefield.bus.session import Bus
from placefield.errors import MessageError


class Odometry:
    """Metres travelled, as the vehicle last said; never going down."""

    def __init__(self) -> None:
        self._before_m = 0.0  # the last restart of the vehicle's own count
        self._last_m: float | None = None

    def listen(self, bus: Bus, keys: Keys) -> None:
        """Take what comes on a run's key from now on."""

        def receive(key: str, payload: bytes) -> None:
            try:
                self._take(OdometryMessage.decode(payload).metres)
            except MessageError as error:
                bus.log_dropped(key, error)

        bus.subscribe_raw(keys.odometry, receive)

    def _take(self, metres: float) -> None:
        if self._last_m is not None and metres < self._last_m:
            self._before_m += self._last_m
        self._last_m = metres

    def metres(self) -> float | None:
        """Return the metres travelled so far; None while the vehicle has said nothing."""
        return None if self._last_m is None else self._before_m + self._last_m
