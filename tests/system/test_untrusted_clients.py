"""Real sessions and processes: which clients may connect, and what each role may do."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import copytree
from typing import Any

import psutil
import pytest
import zenoh
from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509 import load_pem_x509_certificate
from hosting import (
    Host,
    Listener,
    Process,
    answers_of,
    free_endpoint,
    offline,
    placefield,
    refusal,
    wait_until,
)

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.credentials import tls_settings
from placefield.bus.keys import Keys
from placefield.bus.message import MAX_BYTES
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield_tools.security.certificates import Certified, issue
from placefield_tools.security.folders import write_credentials

RUN = "placefield/default/"
CANDIDATE = Keys("default").all_candidates.removeprefix(RUN).replace("*", "x")
MATCHES = ("match", "smoothed", "verified")
STREAMS = (
    "frame",
    "odometry",
    "raw/x",
    "feature",
    "moments",
    "unobserved",
    CANDIDATE,
    *MATCHES,
    "ack",
)
REPORTING = ("featurizer", "describer", "channel", "fuser", "verifier", "mapserver", "mapper")
COUNTS = tuple(f"stats/{role}/x" for role in REPORTING)
TOKENS = tuple(f"alive/{role}/x" for role in ("replay", *REPORTING))
MAP = "placefield/maps/route/manifest"

# What each role may do, as SECURITY.md has it.
PUBLISHES = {
    "camera": {"frame", "odometry"},
    "featurizer": {"feature", "moments", "unobserved", "stats/featurizer/x"},
    "describer": {"raw/x", "stats/describer/x"},
    "channel": {CANDIDATE, "halo/x", "stats/channel/x"},
    "fuser": {"match", "smoothed", "ack", "stats/fuser/x"},
    "verifier": {"verified", "stats/verifier/x"},
    "mapserver": {"stats/mapserver/x"},
    "mapper": {"stats/mapper/x"},
    "dashboard": set[str](),
}
"""Keys without the run's prefix, as in the next tables."""
READS = {
    "camera": {"odometry", "match", "ack", "unobserved"},
    "featurizer": {"frame", "raw/x", "ack"},
    "describer": {"frame"},
    "channel": {"feature", "moments", "halo/x", "match"},
    "fuser": {"feature", "moments", CANDIDATE},
    "verifier": {"frame", "smoothed", "verified"},
    "mapserver": set[str](),
    "mapper": {"frame", "feature"},
    "dashboard": {*STREAMS, *COUNTS, "halo/x"},
}
IS_ALIVE_AS = {
    "camera": {"alive/replay/x"},
    "dashboard": set[str](),
    **{role: {f"alive/{role}/x"} for role in REPORTING},
}
SERVICES = {"featurizer", "channel", "fuser", "verifier"}
ANSWERS = {RUN + "cache/feature": SERVICES | {"mapper"}, MAP: {"mapserver"}}
ASKS = {RUN + "cache/feature": SERVICES | {"dashboard", "mapper"}, MAP: SERVICES | {"describer"}}
ROLES = tuple(PUBLISHES)


@pytest.fixture(scope="module")
def issued(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Credentials of ours."""
    folder = tmp_path_factory.mktemp("untrusted") / "issued"
    write_credentials(folder, [], days=30)
    return folder


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Credentials of another authority, which bears the same name."""
    folder = tmp_path_factory.mktemp("untrusted") / "others"
    write_credentials(folder, [], days=30)
    return folder


@pytest.fixture(scope="module")
def endpoint(issued: Path) -> Iterator[str]:
    """The endpoint of a router that accepts only our credentials."""
    at = free_endpoint().replace("tcp/", "tls/")
    with open_router(BusConfig(endpoint=at, credentials=str(issued / "router"))):
        yield at


def test_this_file_covers_all_roles(issued: Path) -> None:
    folders = {folder.name for folder in issued.iterdir() if folder.is_dir()}
    assert folders == {*ROLES, "router"}


def raw(endpoint: str, *, mode: str = "client", **tls: object) -> zenoh.Session:
    """Open a session without Placefield's own checks.

    Raises:
        zenoh.ZError: the router refuses it.
    """
    settings: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": [],
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    settings |= {f"transport/link/tls/{name}": value for name, value in tls.items()}
    config = zenoh.Config()
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


def may_connect(endpoint: str, **tls: object) -> bool:
    try:
        raw(endpoint, **tls).close()
    except zenoh.ZError:
        return False
    return True


def session_of(bus: Bus) -> zenoh.Session:
    return bus._session


def shown(folder: Path) -> dict[str, object]:
    """Return the settings with which a session presents the certificate of a folder."""
    return {
        "enable_mtls": True,
        "connect_certificate": str(folder / "certificate.pem"),
        "connect_private_key": str(folder / "key.pem"),
    }


def expired(issued: Path, folder: Path) -> Path:
    """Write a certificate of our authority that has expired."""
    copytree(issued / "camera", folder)
    key = load_pem_private_key((issued / "ca-key.pem").read_bytes(), password=None)
    assert isinstance(key, EllipticCurvePrivateKey)
    own = load_pem_x509_certificate((issued / "ca.pem").read_bytes())
    certified = issue(Certified(own, key), "camera", days=-1)
    (folder / "certificate.pem").write_bytes(certified.certificate_pem)
    (folder / "key.pem").write_bytes(certified.key_pem)
    return folder


def test_only_a_client_with_a_valid_certificate_of_the_authority_may_connect(
    endpoint: str, issued: Path, others: Path, tmp_path: Path
) -> None:
    ours = {"root_ca_certificate": str(issued / "ca.pem")}
    assert may_connect(endpoint, **ours, **shown(issued / "camera"))
    clients: dict[str, tuple[str, dict[str, object]]] = {
        "no TLS": (endpoint.replace("tls/", "tcp/"), {}),
        "no certificate": (endpoint, ours),
        "no certificate though asked": (endpoint, ours | {"enable_mtls": True}),
        "another authority's": (endpoint, ours | shown(others / "camera")),
        "expired": (endpoint, ours | shown(expired(issued, tmp_path / "expired"))),
    }
    for client, (at, tls) in clients.items():
        assert not may_connect(at, **tls), client


def test_clients_verify_the_certificate_of_the_router(endpoint: str, issued: Path) -> None:
    ours: dict[str, object] = {
        "root_ca_certificate": str(issued / "ca.pem"),
        **shown(issued / "camera"),
    }
    elsewhere = endpoint.replace("127.0.0.1", "127.0.0.2")  # of which the certificate is not
    false = free_endpoint().replace("tcp/", "tls/")
    config = zenoh.Config()
    settings = {"mode": "router", "listen/endpoints": [false], "scouting/multicast/enabled": False}
    for name, value in (settings | tls_settings(issued / "camera")).items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config):
        assert not may_connect(false, **ours)
    with open_router(BusConfig(endpoint=elsewhere, credentials=str(issued / "router"))):
        assert not may_connect(elsewhere, **ours)


def test_a_command_that_is_refused_says_so_in_one_line(endpoint: str, others: Path) -> None:
    hurried = ("--endpoint", endpoint, "--set", "bus.connect_timeout_s=0.3")
    line = refusal(placefield("listen", *hurried, "--credentials", others / "dashboard"))
    assert f"no router at {endpoint}" in line
    assert "it refuses these credentials" in line


@contextmanager
def sessions(endpoint: str, issued: Path, roles: Sequence[str] = ROLES) -> Iterator[dict[str, Bus]]:
    with ExitStack() as stack:
        configs = {
            role: BusConfig(endpoint=endpoint, credentials=str(issued / role)) for role in roles
        }
        yield {role: stack.enter_context(open_bus(config)) for role, config in configs.items()}


def gather(into: set[tuple[str, str]], name: str) -> Callable[[str, bytes], None]:
    return lambda key, payload: into.add((name, f"{payload.decode()} {key.removeprefix(RUN)}"))


def test_each_role_publishes_and_reads_only_what_it_may(endpoint: str, issued: Path) -> None:
    keys = (*STREAMS, *COUNTS, "halo/x", "anything")
    received: set[tuple[str, str]] = set()
    expected = {
        (reader, f"{writer} {key}")
        for reader in ROLES
        for writer in ROLES
        for key in READS[reader] & PUBLISHES[writer]
    }
    with sessions(endpoint, issued) as readers, sessions(endpoint, issued) as writers:
        for role, bus in readers.items():
            bus.subscribe_raw(RUN + "**", gather(received, role))
            for key in keys:
                bus.subscribe_raw(RUN + key, gather(received, role))

        def is_received() -> bool:
            for role, bus in writers.items():
                for key in keys:
                    session_of(bus).put(RUN + key, role.encode())
                    session_of(bus).delete(RUN + key)
            return received >= expected

        wait_until(is_received, "what is allowed comes")
        time.sleep(0.5)  # and what is not would have come
    assert received == expected


def test_each_role_declares_its_own_token_and_every_role_reads_it(
    endpoint: str, issued: Path
) -> None:
    expected = {RUN + token for tokens in IS_ALIVE_AS.values() for token in tokens}
    with sessions(endpoint, issued) as holders, sessions(endpoint, issued) as lookers:
        for role, bus in holders.items():
            for token in (*TOKENS, "alive/camera/x", "alive/dashboard/x"):
                if token not in IS_ALIVE_AS[role]:
                    bus.declare_alive(f"{RUN}{token}-of-{role}")
            for token in IS_ALIVE_AS[role]:
                bus.declare_alive(RUN + token)
        for bus in lookers.values():
            wait_until(
                lambda bus=bus: bus.alive(RUN + "alive/*/*") >= expected, "all tokens are there"
            )
            assert bus.alive(RUN + "alive/*/*") == expected


def test_each_role_queries_and_answers_only_what_it_may(endpoint: str, issued: Path) -> None:
    def replies(bus: Bus, key: str) -> set[str]:
        return {payload.decode() for payload, _ in bus.ask(key, timeout_s=5)}

    with sessions(endpoint, issued) as answering, sessions(endpoint, issued) as background_query:
        for role, bus in answering.items():
            for key in ANSWERS:
                bus.answer(key, lambda key, asked, role=role: [(role.encode(), b"")])
        for key, allowed in ANSWERS.items():
            wait_until(
                lambda key=key, a=allowed: replies(background_query["fuser"], key) >= a, "answers"
            )
            for role, bus in background_query.items():
                assert replies(bus, key) == (allowed if role in ASKS[key] else set()), (role, key)


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
def test_a_camera_does_no_more_as_whatever_it_connects(
    endpoint: str, issued: Path, mode: str
) -> None:
    received: list[str] = []
    ours = {"root_ca_certificate": str(issued / "ca.pem"), **shown(issued / "camera")}
    with sessions(endpoint, issued, ["dashboard", "fuser"]) as ordinary:
        ordinary["dashboard"].subscribe_raw("placefield/**", lambda key, _: received.append(key))
        with raw(endpoint, mode=mode, **ours) as camera:
            read: list[str] = []
            readers = [
                camera.declare_subscriber(key, lambda sample: read.append(str(sample.key_expr)))
                for key in ("**", RUN + "match", RUN + "ack")
            ]
            time.sleep(0.5)
            for key in ("match", "feature", CANDIDATE, "**", "frame"):
                camera.put(RUN + key, b"forged", allowed_destination=zenoh.Locality.REMOTE)
            for key in ("match", "ack"):
                session_of(ordinary["fuser"]).put(RUN + key, b"")
            wait_until(lambda: len(received) >= 3 and len({*read}) >= 2, "what is allowed comes")
            time.sleep(0.3)
            assert set(read) == {RUN + "ack", RUN + "match"}
            assert sorted(received) == sorted(RUN + key for key in ("frame", "match", "ack"))
            del readers


def test_roles_hold_across_routers_that_trust_each_other(endpoint: str, issued: Path) -> None:
    beyond = free_endpoint().replace("tcp/", "tls/")
    second = BusConfig(endpoint=beyond, connect=(endpoint,), credentials=str(issued / "router"))
    received: set[tuple[str, str]] = set()
    with (
        open_router(second),
        sessions(beyond, issued, ["camera", "channel"]) as there,
        sessions(endpoint, issued, ["featurizer", "dashboard", "fuser"]) as here,
    ):
        here["featurizer"].subscribe_raw(RUN + "frame", gather(received, "featurizer"))
        here["dashboard"].subscribe_raw(RUN + "**", gather(received, "dashboard"))
        there["camera"].subscribe_raw(RUN + "ack", gather(received, "camera"))
        here["featurizer"].answer(RUN + "cache/feature", lambda key, asked: [(b"kept", b"")])
        here["featurizer"].declare_alive(RUN + "alive/featurizer/x")
        wait_until(lambda: there["camera"].alive(RUN + "alive/*/*"), "the token crosses")
        wait_until(lambda: [*there["channel"].ask(RUN + "cache/feature", timeout_s=5)], "cache")
        for key in ("match", "feature", "frame"):
            session_of(there["camera"]).put(RUN + key, b"camera")
        for key in ("match", "ack"):
            session_of(here["fuser"]).put(RUN + key, b"fuser")
        expected = {
            ("featurizer", "camera frame"),
            ("camera", "fuser ack"),
            *(("dashboard", what) for what in ("camera frame", "fuser match", "fuser ack")),
        }
        wait_until(lambda: received >= expected, "what is allowed crosses")
        time.sleep(0.3)
        assert received == expected


def test_with_credentials_all_works_from_frame_to_match_each_in_its_role(
    logs: Path, verified_map_path: Path, query_dir: Path, issued: Path
) -> None:
    at = ("--endpoint", free_endpoint().replace("tcp/", "tls/"), "--credentials")
    flags = ("--workers", "2", "--verifiers", "2", *at, issued / "router")
    with Process(logs, "up", verified_map_path, *flags) as host:
        wait_until(lambda: "\n" in host.out or not host.runs, "the host is ready")
        dashboard = BusConfig(endpoint=at[1], credentials=str(issued / "dashboard"))
        with open_bus(dashboard) as bus:
            listener = Listener(bus)
            replayed = placefield("replay", query_dir, *at, issued / "camera")
            assert replayed.returncode == 0, replayed.stderr
            files, placemap = sorted(query_dir.iterdir()), open_map(verified_map_path)
            assert answers_of(listener.answers()) == offline(placemap, files)
            wait_until(lambda: listener.count("verifier", "verified") >= len(files), "all verified")
        status = placefield("status", *at, issued / "dashboard").stdout
        assert all(service in status for service in SERVICES)
        assert not host.err


def test_up_says_which_services_credentials_are_missing(
    map_path: Path, issued: Path, tmp_path: Path
) -> None:
    copytree(issued / "router", tmp_path / "router")
    at = ("--endpoint", free_endpoint().replace("tcp/", "tls/"))
    line = refusal(placefield("up", map_path, *at, "--credentials", tmp_path / "router"))
    assert f"{tmp_path / 'featurizer' / 'ca.pem'}: No such file" in line


def test_by_default_only_one_port_is_open_and_only_on_loopback(
    host: Host,
) -> None:
    family = [psutil.Process(host.pid), *host.children()]
    sockets = [socket for process in family for socket in process.net_connections("inet")]
    listening = [socket for socket in sockets if socket.status == psutil.CONN_LISTEN]
    assert [f"tcp/{socket.laddr.ip}:{socket.laddr.port}" for socket in listening] == [host.endpoint]
    assert {socket.laddr.ip for socket in sockets} == {"127.0.0.1"}
    assert all(socket.raddr for socket in sockets if socket not in listening)  # no datagrams


def test_messages_over_the_limit_reach_no_service_and_do_not_pile_up(
    host: Host, listener: Listener, route_map: Map, query_dir: Path
) -> None:
    family = {"router": psutil.Process(host.pid)}
    family |= {f"service {child.pid}": child for child in host.children()}
    most = {name: process.memory_info().rss for name, process in family.items()}
    before, stop = dict(most), threading.Event()

    def watch() -> None:
        while not stop.wait(0.01):
            for name, process in family.items():
                most[name] = max(most[name], process.memory_info().rss)

    watching = threading.Thread(target=watch)
    watching.start()
    try:
        with raw(host.endpoint) as untrusted_client:
            huge = bytes(MAX_BYTES + 1)
            for key in ("frame", "match", "frame", "match"):
                untrusted_client.put(
                    RUN + key, huge, congestion_control=zenoh.CongestionControl.BLOCK
                )
            wait_until(lambda: listener.alive("fuser"), "the bus lives")
        host.replay(query_dir, "--stride", "6")
        images = sorted(query_dir.iterdir())[::6]
        assert answers_of(listener.answers()) == offline(route_map, images)
    finally:
        stop.set()
        watching.join()
    grown = {name: most[name] - before[name] for name in family}
    assert grown.pop("router") < 2.5 * MAX_BYTES  # one is cut off while the next one comes
    assert max(grown.values()) < MAX_BYTES / 4
