"""The bus: whether a router is there, or its port is free for one."""

import re
import socket
from collections.abc import Collection, Iterator, Sequence

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys, service_and_identity
from placefield.config import BusConfig
from placefield.errors import BusError, PlacefieldError
from placefield_tools.doctor.finding import Finding, bad, good, warning
from placefield_tools.status.service_status import other_runs

_TIMEOUT_S = 1.0
_ADDRESS = re.compile(r"(?P<protocol>\w+)/\[?(?P<host>[^\]]+?)\]?:(?P<port>\d+)")


def network(bus: BusConfig, runs: Sequence[str]) -> Iterator[Finding]:
    """Look at the endpoint of the bus, and at the services of these runs."""
    try:
        with open_bus(bus.model_copy(update={"connect_timeout_s": _TIMEOUT_S})) as opened:
            yield good("router", f"answers at {bus.endpoint}")
            all_runs = opened.runs()
            for run in runs:
                tokens = opened.alive(Keys(run).all_alive())
                alive = {service_and_identity(token)[0] for token in tokens}
                yield of_services(run, alive, all_runs)
    except BusError:
        yield of_endpoint(bus.endpoint)
    except PlacefieldError as error:
        yield bad("router", str(error), "see above")


def of_services(run: str, alive: set[str], all_runs: Collection[str]) -> Finding:
    """Look at the services of a run that are alive, among all runs that have any."""
    missing = sorted({"featurizer", "channel", "fuser"} - alive)
    if missing:
        advice = "start them with 'placefield up MAP'; see 'placefield status'"
        if others := other_runs(run, all_runs):
            advice = f"{others}, or {advice}"
        return warning(f"run {run!r}", f"no {', no '.join(missing)}", advice)
    return good(f"run {run!r}", "featurizer, channels and fuser are alive")


def of_endpoint(endpoint: str) -> Finding:
    """Look at an endpoint where no router answers."""
    address = _ADDRESS.fullmatch(endpoint)
    if address is None:
        advice = "write it as tcp/HOST:PORT or tls/HOST:PORT"
        return bad("router", f"{endpoint} is no endpoint", advice)
    host, port = address["host"], int(address["port"])
    try:
        with socket.create_connection((host, port), _TIMEOUT_S):
            pass
    except ConnectionRefusedError:
        advice = "none needed yet: 'placefield up MAP' starts one"
        return warning("router", f"no router listens at {endpoint}", advice)
    except OSError as error:
        advice = "is the host right, and does a firewall let the port through?"
        return bad("router", f"{endpoint} cannot be reached ({error})", advice)
    advice = "another program has the port, or the router wants other --credentials"
    return bad("router", f"something at {endpoint} does not answer as a router", advice)
