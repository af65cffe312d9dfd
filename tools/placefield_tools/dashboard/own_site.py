"""What only this dashboard's own pages may ask of it.

A page of another site, open in the same browser, could else look on and start replays.
"""

from collections.abc import Collection
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


class OwnSite:
    """Refuses what comes from a page of another site, and what asks for another host's."""

    def __init__(self, app: ASGIApp, hosts: Collection[str]) -> None:
        """Take the names that the dashboard is known by; none: whatever it is called."""
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on what may be asked."""
        if scope["type"] == "lifespan" or self._is_own(Headers(scope=scope)):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse("not from this page", 403)(scope, receive, send)

    def _is_own(self, headers: Headers) -> bool:
        host, origin = headers.get("host", ""), headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return False
        return not self._hosts or urlsplit(f"//{host}").hostname in self._hosts
