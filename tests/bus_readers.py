"""When a subscription has got around, so that nothing is published too early."""

import time

from placefield.bus.keys import Keys
from placefield.bus.session import Bus

_PATIENCE_S = 60.0


def await_reader(reader: Bus, sender: Bus, keys: Keys) -> None:
    """Wait until the sender knows of all that the reader has subscribed to by now.

    The reader declares a token behind its subscriptions; the sender learns of them in this order.
    """
    reader.declare_alive(keys.alive("test", "reader"))
    end = time.monotonic() + _PATIENCE_S
    while not sender.alive(keys.all_alive("test")):
        assert time.monotonic() < end, "in vain"
        time.sleep(0.01)
