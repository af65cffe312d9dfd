import time
from collections.abc import Callable

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.config import BusConfig
from placefield_tools.status.statistics import RunsListener


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_runs_are_known_whether_they_were_there_before_or_come_later_until_they_go(
    endpoint: str,
) -> None:
    config = BusConfig(endpoint=endpoint)
    with open_router(config), open_bus(config) as listening:
        with open_bus(config) as early:
            early.declare_alive(Keys("out_of_order").alive("fuser", "a"))
            runs_listener = RunsListener(listening)
            wait_until(lambda: runs_listener.runs == {"out_of_order"})
            with open_bus(config) as late:
                late.declare_alive(Keys("late").alive("featurizer", "b"))
                late.declare_alive(Keys("late").alive("fuser", "c"))
                wait_until(lambda: runs_listener.runs == {"out_of_order", "late"})
            wait_until(lambda: runs_listener.runs == {"out_of_order"})
        wait_until(lambda: not runs_listener.runs)
