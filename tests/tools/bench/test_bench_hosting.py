"""Processes that are ready inside a block and gone after it."""

import sys

import psutil
import pytest

from placefield.errors import BusError
from placefield_tools.bench.host_chain import started

READY = """
import signal, subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
signal.signal(signal.SIGTERM, lambda *_: sys.exit())
print("ready", sys.argv[1:], flush=True)
signal.pause()
"""


def test_hosts_are_ready_each_at_a_port_of_its_own_and_end_with_the_block() -> None:
    with started([[sys.executable, "-c", READY]] * 2) as chains:
        assert len({chain.endpoint for chain in chains}) == 2
        family = [psutil.Process(chain.pid) for chain in chains]
        family += [child for host in family for child in host.children()]
        assert len(family) == 4
        assert all(chain.cpu_seconds() > 0 for chain in chains)
    assert not psutil.wait_procs(family, timeout=60)[1]


def test_a_host_that_does_not_get_ready_is_refused() -> None:
    with pytest.raises(BusError, match="did not start"), started([[sys.executable, "-c", ""]]):
        pass
