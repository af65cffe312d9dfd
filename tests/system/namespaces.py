"""Hosts on a network of their own, whose links can be cut: Linux network namespaces.

Each is one end of a cable to a switch; no packet leaves the machine, and its own network is left
alone. What runs in a namespace has the loopback of that namespace.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import pytest
from hosting import PATIENCE_S, PLACEFIELD, Process, environment

_SWITCH = "switch"
_SUBNET = "10.77.0"


class Namespaces:
    """Named hosts that reach each other."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)

    def address(self, name: str) -> str:
        """Return the address at which the others reach a host."""
        return f"{_SUBNET}.{self._names.index(name) + 1}"

    def inside(self, name: str) -> list[str]:
        """Return what stands before a command that is to run on a host."""
        return ["ip", "netns", "exec", _namespace(name)]

    def run(self, name: str, *command: str | Path) -> "subprocess.CompletedProcess[str]":
        """Run a command on a host to its end."""
        return subprocess.run(
            [*self.inside(name), *map(str, command)],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            env=environment(),
            check=False,
        )

    def cut(self, name: str) -> None:
        """Pull a host's cable."""
        _ip("-n", _namespace(_SWITCH), "link", "set", name, "down")

    def mend(self, name: str) -> None:
        """Plug it in again."""
        _ip("-n", _namespace(_SWITCH), "link", "set", name, "up")

    def received(self, name: str) -> int:
        """Return how many bytes have come to a host, headers included."""
        shown = _ip("-n", _namespace(_SWITCH), "-s", "-json", "link", "show", name)
        return int(json.loads(shown)[0]["stats64"]["tx"]["bytes"])


class NamespaceProcess(Process):
    """A command of ours on one of the hosts."""

    def __init__(
        self, folder: Path, network: Namespaces, name: str, *arguments: str | Path
    ) -> None:
        super().__init__(folder, *arguments)
        self._command = [*network.inside(name), *PLACEFIELD, *map(str, arguments)]

    def _start(self, out: IO[str], err: IO[str]) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            self._command,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env=environment(),
        )


@contextmanager
def namespaces(names: Sequence[str]) -> Iterator[Namespaces]:
    """Make hosts of these names, of at most 15 characters, for the length of the block.

    Skips the test where they can't be made.
    """
    _skip_where_impossible()
    with ExitStack() as made:
        made.enter_context(_made(_SWITCH))
        switch = _namespace(_SWITCH)
        _ip("-n", switch, "link", "add", "bridge", "type", "bridge")
        _ip("-n", switch, "link", "set", "bridge", "up")
        for number, name in enumerate(names, 1):
            made.enter_context(_made(name))
            own = _namespace(name)
            cable = ("type", "veth", "peer", "name", "uplink", "netns", own)
            _ip("-n", switch, "link", "add", name, *cable)
            _ip("-n", switch, "link", "set", name, "master", "bridge", "up")
            _ip("-n", own, "address", "add", f"{_SUBNET}.{number}/24", "dev", "uplink")
            _ip("-n", own, "link", "set", "uplink", "up")
        yield Namespaces(names)


def _skip_where_impossible() -> None:
    if os.geteuid() != 0:
        pytest.skip("network namespaces are for root")
    if shutil.which("ip") is None:
        pytest.skip("network namespaces need the command 'ip'")
    probe = _namespace("probe")
    if subprocess.run(["ip", "netns", "add", probe], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no network namespaces")
    _ip("netns", "delete", probe)


@contextmanager
def _made(name: str) -> Iterator[None]:
    _ip("netns", "add", _namespace(name))
    try:
        _ip("-n", _namespace(name), "link", "set", "lo", "up")
        yield
    finally:
        _ip("netns", "delete", _namespace(name))


def _namespace(name: str) -> str:
    return f"placefield-{os.getpid()}-{name}"


def _ip(*arguments: str) -> str:
    return subprocess.run(["ip", *arguments], capture_output=True, text=True, check=True).stdout
