import shlex
from pathlib import Path

from placefield.config import Config
from placefield_tools.dashboard.commands import Commands


def test_commands_name_the_run_and_the_bus_only_where_they_are_not_the_default() -> None:
    usual = Commands(Config().run, Path("a b.pfmap"), Config().bus.endpoint)
    assert shlex.split(usual.up) == ["placefield", "up", "a b.pfmap"]
    assert usual.replay == "placefield replay SOURCE"
    assert usual.inspect == "placefield inspect MAP"
    other = Commands("night", Path("a.pfmap"), "tcp/vehicle:7447")
    assert other.dashboard == "placefield dashboard MAP --run night --endpoint tcp/vehicle:7447"
