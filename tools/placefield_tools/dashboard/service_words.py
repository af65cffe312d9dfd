"""How the services are, in words, and whether a run can still answer."""

from placefield_tools.common.natural_sort import counted
from placefield_tools.status.service_status import RunStatus, ServiceStatus

_UNDER_WAY = 1  # frames that a service may be behind
_WAITS = "verifier"  # for the frames that smoothing takes, so that it is behind on purpose
_ANSWERING = ("featurizer", "fuser")  # a run without a channel still answers


def can_answer(status: RunStatus) -> bool:
    """Return whether a new match can come. If not, the shown match is old."""
    gone = (*status.missing, *silent(status))
    return not any(each.startswith(_ANSWERING) for each in gone)


def silent(status: RunStatus) -> tuple[str, ...]:
    """Name the services that are there and have reported, but no longer do: they hang."""
    return tuple(sorted({each.name for each in status.services if _hangs(each)}))


def frames_behind(service: ServiceStatus) -> int:
    """Return how many frames a service is behind without need."""
    return 0 if service.service == _WAITS else service.behind or 0


def state_in_words(service: ServiceStatus) -> str:
    """Say how a service is: running, how far behind, how many frames it missed, or silent."""
    if service.silent:
        return "silent" if _hangs(service) else "starting"
    missed = service.counts.get("gaps", 0)
    parts = [
        f"{_behind_in_words(service)} behind" if _is_slow(service) else "running",
        f"{counted(missed, 'frame')} missed" if missed else "",
    ]
    return ", ".join(filter(None, parts))


def slowest_in_words(status: RunStatus) -> str:
    """Name the service that most frames wait for; the text is empty if it is one frame."""
    slowest = max(status.services, key=frames_behind, default=None)
    if slowest is None or not _is_slow(slowest):
        return ""
    return f"{slowest.name}, {_behind_in_words(slowest)} behind"


def _hangs(service: ServiceStatus) -> bool:
    return service.silent and bool(service.counts)


def _is_slow(service: ServiceStatus) -> bool:
    return frames_behind(service) > _UNDER_WAY


def _behind_in_words(service: ServiceStatus) -> str:
    behind = service.behind or 0
    seconds = f" ({behind / service.rate:.1f} s)" if service.rate else ""
    return f"{counted(behind, 'frame')}{seconds}"
