import shlex
from pathlib import Path

from placefield.config import BusConfig
from placefield_tools.dashboard.commands import Commands


def test_commands_name_the_bus_only_where_it_is_not_the_usual_one() -> None:
    usual = Commands("night", Path("a b.pfmap"), BusConfig().endpoint)
    assert shlex.split(usual.up) == ["placefield", "up", "a b.pfmap", "--run", "night"]
    assert usual.replay == "placefield replay SOURCE --run night"
    other = Commands("night", Path("a.pfmap"), "tcp/vehicle:7447")
    assert other.dashboard.endswith(" --run night --endpoint tcp/vehicle:7447")
