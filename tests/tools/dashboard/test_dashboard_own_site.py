import asyncio
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the dashboard's extra is not installed")

from placefield_tools.dashboard.own_site import LOOPBACK, OwnSite


async def _app(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "served"})


def asked(kind: str, hosts: frozenset[str] = LOOPBACK, **headers: str) -> list[dict[str, Any]]:
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {}

    raw = [(name.encode(), value.encode()) for name, value in headers.items()]
    asyncio.run(OwnSite(_app, hosts)({"type": kind, "headers": raw}, receive, send))
    return sent


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost"])
def test_the_dashboards_own_pages_are_served(kind: str, host: str) -> None:
    assert asked(kind, host=host) == [{"type": "served"}]
    assert asked(kind, host=host, origin=f"http://{host}") == [{"type": "served"}]


def test_a_page_of_another_site_is_refused() -> None:
    headers = {"host": "localhost:8080", "origin": "https://elsewhere.example"}
    assert asked("http", **headers)[0]["status"] == 403
    assert asked("websocket", **headers) == [{"type": "websocket.close", "code": 1008}]
    assert asked("websocket", frozenset(), **headers)[0]["type"] == "websocket.close"
    headers["origin"] = "http://localhost:9090"
    assert asked("http", **headers)[0]["status"] == 403


def test_another_name_for_this_host_is_refused_on_loopback_alone() -> None:
    headers = {"host": "elsewhere.example", "origin": "http://elsewhere.example"}
    assert asked("http", **headers)[0]["status"] == 403
    assert asked("http", frozenset(), **headers) == [{"type": "served"}]
