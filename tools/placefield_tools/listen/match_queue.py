"""What a person is told who listens to a run; the matches themselves are ``placefield.bus``'s."""

import logging

from placefield.bus.matches import MatchQueue, stream_matches
from placefield.bus.session import Bus
from placefield_tools.status.service_status import other_runs

__all__ = ["MatchQueue", "stream_matches", "warn_of_other_runs"]

log = logging.getLogger(__name__)


def warn_of_other_runs(bus: Bus, run: str) -> None:
    """Log which runs there are if this one has no service: its name may be wrong."""
    if others := other_runs(run, bus.runs()):
        log.warning("run %r has no service yet; %s", run, others)
