import asyncio
import socket
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the dashboard's extra is not installed")

from placefield_tools.dashboard.same_origin import LOOPBACK, SameOrigin, names_of


async def _app(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})


def asked(kind: str, at: str = "127.0.0.1", **headers: str) -> list[dict[str, Any]]:
    """What is sent of a dashboard that is served at a host."""
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {}

    raw = [(name.encode(), value.encode()) for name, value in headers.items()]
    site = SameOrigin(_app, names_of(at, ["robot.example"]), addresses=at not in LOOPBACK)
    asyncio.run(site({"type": kind, "headers": raw}, receive, send))
    return sent


def status(kind: str, at: str = "127.0.0.1", **headers: str) -> int:
    (first, *_) = asked(kind, at, **headers)
    return int(first.get("status", first.get("code", 0)))


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost", "robot.example:80"]
)
def test_the_dashboards_own_pages_are_served(kind: str, host: str) -> None:
    for at in ("127.0.0.1", "0.0.0.0"):
        assert status(kind, at, host=host) == 200
        assert status(kind, at, host=host, origin=f"http://{host}") == 200


@pytest.mark.parametrize("at", ["127.0.0.1", "0.0.0.0"])
@pytest.mark.parametrize(
    "origin", ["https://elsewhere.example", "http://localhost:9090", "null", "file://"]
)
def test_a_page_of_another_site_is_refused(at: str, origin: str) -> None:
    assert status("http", at, host="localhost:8080", origin=origin) == 403
    assert status("websocket", at, host="localhost:8080", origin=origin) == 1008


@pytest.mark.parametrize("at", ["127.0.0.1", "0.0.0.0"])
def test_a_name_that_another_site_lets_point_here_is_refused(at: str) -> None:
    headers = {"host": "elsewhere.example", "origin": "http://elsewhere.example"}
    assert status("http", at, **headers) == 403
    assert status("websocket", at, **headers) == 1008


def test_beyond_loopback_a_host_is_known_by_its_name_and_its_addresses() -> None:
    for host in (socket.gethostname(), "192.168.7.4:8080", "[fe80::1]:8080"):
        assert status("http", "0.0.0.0", host=host) == 200
        assert status("http", "127.0.0.1", host=host) == 403


@pytest.mark.parametrize("malformed", [{"host": "["}, {"host": "x", "origin": "http://["}])
def test_what_is_malformed_is_a_bad_request(malformed: dict[str, str]) -> None:
    assert status("http", **malformed) == 400
    assert status("websocket", **malformed) == 1008


def test_no_other_page_may_frame_these() -> None:
    for host in ("localhost", "elsewhere.example"):
        headers = {
            name.decode(): value.decode() for name, value in asked("http", host=host)[0]["headers"]
        }
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
