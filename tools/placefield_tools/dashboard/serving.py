"""The dashboard's pages and pictures over HTTP."""

import logging
import socket
import threading
import time
from collections.abc import Callable, Collection
from types import FrameType

import uvicorn
from fastapi import FastAPI, Response
from fastapi.concurrency import run_in_threadpool
from nicegui import app, ui

from placefield.errors import ConfigError, FrameError, MessageError
from placefield_services.process import leave
from placefield_tools.dashboard.columns import LOOK_BACK
from placefield_tools.dashboard.frame_images import distance_picture, frame_picture
from placefield_tools.dashboard.live_page import live_page
from placefield_tools.dashboard.map_page import map_page
from placefield_tools.dashboard.same_origin import LOOPBACK, SameOrigin, names_of
from placefield_tools.dashboard.site import Site

log = logging.getLogger(__name__)

_DRAIN_EVERY_S = 0.1
_END_WITHIN_S = 1
_LEAVE_AFTER_S = 1.5  # nothing is left to finish, and a replay ends with this process
_BACK_WITHIN_S = 30.0  # a browser that is too busy to answer may come back


def serve(
    site: Site, host: str, port: int, names: Collection[str], on_ready: Callable[[], None]
) -> None:
    """Serve the pages until SIGINT or SIGTERM.

    Args:
        site: the run that the pages show.
        host: address to serve the pages at.
        port: port to serve the pages at.
        names: further names of this host.
        on_ready: called when the pages are served.

    Raises:
        ConfigError: the address is not one of this machine, or the port is in use.
    """
    _check_free(host, port)
    if host not in LOOPBACK:
        log.warning(
            "%s: everyone who reaches this address can watch the run and replay files of this host",
            host,
        )
    web = FastAPI(openapi_url=None)
    _add_pictures(web, site)
    ui.page("/", title="Placefield: live")(lambda: live_page(site))
    ui.page("/map", title="Placefield: map")(lambda: map_page(site))
    app.timer(_DRAIN_EVERY_S, site.feed.drain)
    ui.run_with(
        web,
        title="Placefield",
        dark=None,
        tailwind=False,
        language="en-US",
        show_welcome_message=False,
        reconnect_timeout=_BACK_WITHIN_S,
    )
    web.add_middleware(SameOrigin, names=names_of(host, names), addresses=host not in LOOPBACK)
    config = uvicorn.Config(
        web,
        host=host,
        port=port,
        log_level="warning",
        ws="wsproto",
        timeout_graceful_shutdown=_END_WITHIN_S,
    )
    _Server(config, on_ready).run()


class _Server(uvicorn.Server):
    """A server that ends soon after a signal, even if browsers still hold connections."""

    def __init__(self, config: uvicorn.Config, on_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_ready = on_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start to listen, then call ``on_ready``."""
        await super().startup(sockets=sockets)
        if self.started:
            self._on_ready()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End on a signal."""
        threading.Thread(target=_leave_soon, daemon=True).start()
        super().handle_exit(sig, frame)


def _leave_soon() -> None:
    time.sleep(_LEAVE_AFTER_S)
    leave()


def _check_free(host: str, port: int) -> None:
    try:
        with socket.create_server((host, port)):
            pass
    except OSError as error:
        raise ConfigError(
            f"--host {host} --port {port}: {error.strerror}; give another one"
        ) from None


def _add_pictures(web: FastAPI, site: Site) -> None:
    """Add the pictures' routes. Pictures are drawn in other threads, which use no state."""
    state = site.state

    @web.get("/frame/{number}.jpg")
    async def frame(number: int) -> Response:
        answer = state.at(number)
        payload = None if answer is None else state.frame(answer)
        if payload is None:
            return Response(status_code=404)
        try:
            picture = await run_in_threadpool(frame_picture, payload)
        except (FrameError, MessageError):
            return Response(status_code=404)
        if picture is None:
            return Response(status_code=404)
        return Response(picture, media_type="image/jpeg")

    @web.get("/distances/{number}.png")
    async def distances(number: int) -> Response:
        answer = state.at(number)
        if answer is None:
            return Response(status_code=404)
        rows = {one.header.sequence: one.distances for one in state.before(answer, LOOK_BACK)}
        last = answer.header.sequence
        in_turn = [rows.get(frame) for frame in range(last - LOOK_BACK + 1, last + 1)]
        picture = await run_in_threadpool(distance_picture, in_turn, state.columns.count)
        return Response(picture, media_type="image/png")

    @web.get("/place/{place}.jpg")
    async def place(place: int) -> Response:
        places = site.placemap.places
        if not (places.has_thumbnails and 0 <= place < places.count):
            return Response(status_code=404)
        return Response(places.thumbnail(place), media_type="image/jpeg")
