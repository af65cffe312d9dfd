"""What only this dashboard's own pages may ask of it, and what browsers are told of them.

A page of another site, open in the same browser, could else look on and start replays: directly, or
by a name of its own that it lets point here (DNS rebinding).
"""

import socket
from collections.abc import Collection
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})

_TOLD = {
    # NiceGUI's pages have scripts and styles of their own within, and compile templates.
    "Content-Security-Policy": "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; "
    "object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


def names_of(host: str, others: Collection[str]) -> frozenset[str]:
    """Return the names that a dashboard is known by which is served at a host.

    Besides those of loopback and the other ones, if it is served beyond loopback: the host's own
    name, alone and with its domain.
    """
    if host in LOOPBACK:
        return LOOPBACK | {*others}
    name = socket.gethostname().lower()
    return LOOPBACK | {*others, host, name, f"{name}.local", socket.getfqdn().lower()}


class OwnSite:
    """Refuses what comes from a page of another site, and what asks for another host's."""

    def __init__(self, app: ASGIApp, names: Collection[str], *, addresses: bool) -> None:
        """Take the names that the dashboard is known by, and whether it is by any address.

        No site can let an address of its own point here.
        """
        self._app, self._names, self._addresses = app, names, addresses

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on what may be asked."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refused = self._refused(Headers(scope=scope))
        if refused is None:
            await self._app(scope, receive, _telling(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(*refused)(scope, receive, _telling(send))

    def _refused(self, headers: Headers) -> tuple[str, int] | None:
        """Return what is answered, and its status; None where it may be asked."""
        host, origin = headers.get("host", ""), headers.get("origin")
        try:
            name = urlsplit(f"//{host}").hostname
            from_host = host if origin is None else urlsplit(origin).netloc
        except ValueError:
            return "malformed Host or Origin", 400
        if from_host != host:
            return "not from this page", 403
        if name is None or not (name in self._names or (self._addresses and _is_address(name))):
            return f"not known as {host[:80]!r}: see placefield dashboard --name", 403
        return None


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def _telling(send: Send) -> Send:
    """Return what sends, and adds what browsers are told to the headers."""

    async def tell(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(_TOLD)
        await send(message)

    return tell
