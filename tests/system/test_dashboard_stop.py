"""A dashboard ends on request, even with clients connected."""

import base64
import os
import socket
from contextlib import ExitStack
from pathlib import Path

import pytest
from hosting import Host, Process, wait_until

from placefield_tools.common.host_process import free_endpoint

pytest.importorskip("nicegui", reason="the dashboard's extra is not installed")

_SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="


def _connect(port: int, sent: str) -> socket.socket:
    connected = socket.create_connection(("127.0.0.1", port))
    connected.sendall(sent.replace("\n", "\r\n").format(port=port).encode())
    return connected


def _silent(port: int) -> socket.socket:
    return _connect(port, "")


def _half_a_request(port: int) -> socket.socket:
    return _connect(port, "GET / HTTP/1.1\nHost: 127.0.0.1:{port}\n")


def _kept_open(port: int) -> socket.socket:
    page = _connect(port, "GET / HTTP/1.1\nHost: 127.0.0.1:{port}\n\n")
    assert page.recv(12) == b"HTTP/1.1 200"
    return page


def _long_polling(port: int) -> socket.socket:
    return _connect(port, f"GET {_SOCKET}polling HTTP/1.1\nHost: 127.0.0.1:{{port}}\n\n")


def _websocket(port: int) -> socket.socket:
    key = base64.b64encode(os.urandom(16)).decode()
    browser = _connect(
        port,
        f"GET {_SOCKET}websocket HTTP/1.1\nHost: 127.0.0.1:{{port}}\nUpgrade: websocket\n"
        f"Connection: Upgrade\nSec-WebSocket-Key: {key}\nSec-WebSocket-Version: 13\n\n",
    )
    assert browser.recv(12) == b"HTTP/1.1 101"
    return browser


def test_a_dashboard_ends_whoever_is_connected(logs: Path, map_path: Path, host: Host) -> None:
    port = int(free_endpoint().rpartition(":")[2])
    at = ("--endpoint", host.endpoint, "--port", str(port))
    with Process(logs, "dashboard", map_path, *at) as dashboard, ExitStack() as open_still:
        wait_until(lambda: "\n" in dashboard.out or not dashboard.runs, "the dashboard is ready")
        for connect in (_silent, _half_a_request, _kept_open, _long_polling, _websocket):
            for _ in range(3):
                open_still.enter_context(connect(port))
        assert dashboard.stop() == 0, dashboard.err
        assert "Traceback" not in dashboard.err
