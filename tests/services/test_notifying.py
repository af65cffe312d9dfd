import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from bus_doubles import header, received

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.message import Message
from placefield.bus.publishing import Outbox
from placefield.bus.session import Bus
from placefield_services.notifying import NOTIFY_SOCKET, notify_alive, notify_ready
from placefield_services.process import ServiceProcess


class SilentBus(Bus):
    """A bus without readers."""

    def __init__(self) -> None:
        self.outbox = Outbox()

    def put(self, key: str, message: Message) -> None: ...


@pytest.fixture(params=["in a file system", "in none"])
def supervisor(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[socket.socket]:
    """A supervisor's socket, at an address of either kind."""
    in_files = request.param == "in a file system"
    address = str(tmp_path / "n") if in_files else f"\0{tmp_path.name}"
    monkeypatch.setenv(NOTIFY_SOCKET, address.replace("\0", "@"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as opened:
        opened.bind(address)
        opened.setblocking(False)
        yield opened


def notifications(supervisor: socket.socket) -> list[bytes]:
    said = []
    while True:
        try:
            said.append(supervisor.recv(100))
        except BlockingIOError:
            return said


def test_a_supervisor_receives_the_notifications(supervisor: socket.socket) -> None:
    notify_ready()
    notify_alive()
    assert notifications(supervisor) == [b"READY=1", b"WATCHDOG=1"]


def test_a_supervisor_that_does_not_read_blocks_nothing(supervisor: socket.socket) -> None:
    for _ in range(1000):
        notify_alive()
    assert 0 < len(notifications(supervisor)) < 1000


@pytest.mark.parametrize("address", ["", "/nowhere/at/all"])
def test_without_a_supervisor_nothing_happens(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setenv(NOTIFY_SOCKET, address)
    notify_ready()
    monkeypatch.delenv(NOTIFY_SOCKET)
    notify_ready()


def test_a_service_notifies_its_supervisor_from_its_main_loop(supervisor: socket.socket) -> None:
    process = ServiceProcess("fuser", SilentBus(), ["test"])
    inbox, stop = Inbox(process.counts), threading.Event()
    inbox.offer(received(Keys("test").frame, header(0)))
    before_work = []

    def work(message: Received) -> None:
        before_work.extend(notifications(supervisor))
        stop.set()

    process.serve(inbox, work, stop)
    assert before_work == [b"READY=1"]
    assert notifications(supervisor) == [b"WATCHDOG=1"]
