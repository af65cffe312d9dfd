"""Accepts requests from the dashboard's own pages only, and sends security headers to browsers.

Otherwise a page of another site, open in the same browser, could watch a run and start replays:
directly, or by a name of its own that points to this host (DNS rebinding).
"""

import socket
from collections.abc import Collection
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})

_SECURITY_HEADERS = {
    # NiceGUI's pages contain inline scripts and styles, and compile templates.
    "Content-Security-Policy": "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; "
    "object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


def names_of(host: str, others: Collection[str]) -> frozenset[str]:
    """Return the host names that a dashboard answers to.

    Args:
        host: address that the dashboard is served at. Beyond loopback, the host's own name is
            added, alone and with its domain.
        others: further names.
    """
    if host in LOOPBACK:
        return LOOPBACK | {*others}
    name = socket.gethostname().lower()
    return LOOPBACK | {*others, host, name, f"{name}.local", socket.getfqdn().lower()}


class SameOrigin:
    """Refuses requests from pages of another site, and requests for another host's name."""

    def __init__(self, app: ASGIApp, names: Collection[str], *, addresses: bool) -> None:
        """Wrap an application.

        Args:
            app: the application.
            names: host names that the dashboard answers to.
            addresses: whether it also answers to any IP address. No site can use an IP address for
                DNS rebinding.
        """
        self._app, self._names, self._addresses = app, names, addresses

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass an allowed request on, and refuse any other."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refused = self._refused(Headers(scope=scope))
        if refused is None:
            await self._app(scope, receive, _with_security_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(*refused)(scope, receive, _with_security_headers(send))

    def _refused(self, headers: Headers) -> tuple[str, int] | None:
        """Return the answer and status of a refused request; None if it is allowed."""
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


def _with_security_headers(send: Send) -> Send:
    """Return a sender that adds the security headers."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(_SECURITY_HEADERS)
        await send(message)

    return send_with_headers
