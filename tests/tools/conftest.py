"""A web server that misbehaves as a test asks, and the command line in this process."""

import hashlib
import threading
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import ClassVar

import pytest
from command_lines import Run, runner


class WebServer(ThreadingHTTPServer):
    """A server on this machine: what it serves, how it misbehaves, and what it has done.

    Attributes:
        content: bodies by path.
        cuts: lengths after which the next answers are cut off, one for each.
        knows_ranges: whether it heeds Range.
        knows_versions: whether it says which version it sends.
        knows_lengths: whether it says how long a body is.
        sent: bytes of bodies, by path.
        ranges: the Range of each request, None where there was none.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.content: dict[str, bytes] = {}
        self.cuts: list[int] = []
        self.knows_ranges = True
        self.knows_versions = True
        self.knows_lengths = True
        self.sent: dict[str, int] = {}
        self.ranges: list[str | None] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: WebServer
    protocol_version: ClassVar[str] = "HTTP/1.1"

    def do_GET(self) -> None:
        self.close_connection = True
        self.server.ranges.append(self.headers["Range"])
        body = self.server.content.get(self.path)
        if body is None:
            self.send_error(404)
            return
        tag = f'"{hashlib.md5(body).hexdigest()}"'
        start = self._start(tag)
        if start is not None and start >= len(body):
            self.send_response(416)
            self.send_header("Content-Range", f"bytes */{len(body)}")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        if start is None:
            start = 0
            self.send_response(200)
        else:
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {start}-{len(body) - 1}/{len(body)}")
        if self.server.knows_versions:
            self.send_header("ETag", tag)
        if self.server.knows_lengths:
            self.send_header("Content-Length", str(len(body) - start))
        stop = start + self.server.cuts.pop(0) if self.server.cuts else len(body)
        piece = body[start:stop]
        self.server.sent[self.path] = self.server.sent.get(self.path, 0) + len(piece)
        self.end_headers()  # whoever has them may look at what was sent
        with suppress(ConnectionError):
            self.wfile.write(piece)

    def _start(self, tag: str) -> int | None:
        wanted = self.headers["Range"]
        if wanted is None or not self.server.knows_ranges:
            return None
        if self.headers["If-Range"] not in (None, tag):
            return None
        return int(wanted.removeprefix("bytes=").removesuffix("-"))

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def web() -> Iterator[WebServer]:
    with WebServer() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def placefield(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> Run:
    """Run a command line in an empty folder."""
    return runner(tmp_path, monkeypatch, capfd)
