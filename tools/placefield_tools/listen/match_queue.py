"""Matches of a run for a person, with a warning if the run's name may be wrong."""

import logging

from placefield.bus.matches import MatchQueue, stream_matches
from placefield.bus.session import Bus
from placefield_tools.status.service_status import other_runs

__all__ = ["MatchQueue", "stream_matches", "warn_of_other_runs"]

log = logging.getLogger(__name__)


def warn_of_other_runs(bus: Bus, run: str) -> None:
    """Log the names of other runs if this run has no service: its name may be wrong."""
    if others := other_runs(run, bus.runs()):
        log.warning("run %r has no service yet; %s", run, others)
