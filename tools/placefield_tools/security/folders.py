"""Credentials as folders: one for each role, to be copied to the hosts that play it."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from placefield.bus.credentials import AUTHORITY, CERTIFICATE, KEY, ROUTER_SETTINGS
from placefield.bus.settings import router_settings
from placefield.config import BusConfig
from placefield.errors import ConfigError
from placefield.files import named, sync, write_whole
from placefield_tools.security.access import access_control
from placefield_tools.security.certificates import Certified, issue, make_authority
from placefield_tools.security.roles import ROLES, ROUTER

AUTHORITY_KEY = "ca-key.pem"
_PORT = BusConfig().endpoint.rpartition(":")[2]
_LOCAL = ("localhost", "127.0.0.1", "::1")

_HEADING = """\
// A router that accepts clients with a certificate, and lets each do only what its role may do.
// A stock router uses the whole file, with 'zenohd --config {file}'.
// Change its paths if the folder has moved. 'placefield up --credentials' uses only the access
// control.
"""


def write_credentials(folder: Path, hosts: Sequence[str], days: int) -> list[str]:
    """Make an authority and write its credentials, a folder for each role; return the roles.

    Args:
        folder: to be made, or empty.
        hosts: names and addresses, besides loopback's, at which routers listen.
        days: how long the certificates are valid.

    Raises:
        ConfigError: there is something in the folder, or a host is malformed.
        OSError: it cannot be written.
    """
    authority = make_authority("Placefield", days)
    listens_at = [*_LOCAL, *(host for host in dict.fromkeys(hosts) if host not in _LOCAL)]
    issued = {ROUTER: issue(authority, ROUTER, days, listens_at)}
    issued |= {role: issue(authority, role, days) for role in ROLES}
    with _filled_whole(folder) as beside:
        _write_secret(beside / AUTHORITY_KEY, authority.key_pem)
        write_whole(beside / AUTHORITY, authority.certificate_pem)
        for role, certified in issued.items():
            _write_role(beside / role, authority, certified)
        settings = _router_settings(beside, folder, "0.0.0.0" if hosts else "127.0.0.1")
        write_whole(beside / ROUTER / ROUTER_SETTINGS, settings)
    return list(issued)


@contextmanager
def _filled_whole(folder: Path) -> Iterator[Path]:
    """Give a folder to be filled in the block; what is in it is in the other one at the end.

    If the block fails nothing is, and the folder is gone if it was not there.
    """
    was_there = folder.exists()
    if was_there and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: there is something; credentials are written to a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    try:
        with TemporaryDirectory(prefix=".", dir=folder) as temporary:
            yield Path(temporary)
            for entry in Path(temporary).iterdir():
                entry.rename(folder / entry.name)
    except BaseException:
        if not was_there:
            folder.rmdir()
        raise


def _write_role(folder: Path, authority: Certified, certified: Certified) -> None:
    folder.mkdir()
    write_whole(folder / AUTHORITY, authority.certificate_pem)
    write_whole(folder / CERTIFICATE, certified.certificate_pem)
    _write_secret(folder / KEY, certified.key_pem)


def _write_secret(file: Path, secret: bytes) -> None:
    try:
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as opened:
            opened.write(secret)
        sync(file)
    except OSError as error:
        raise named(error, file) from None


def _router_settings(beside: Path, folder: Path, address: str) -> str:
    """Return the router's settings, of credentials that will have moved to the folder."""
    bus = BusConfig(endpoint=f"tls/{address}:{_PORT}", credentials=str(beside / ROUTER))
    moved = {
        path: value.replace(str(beside.resolve()), str(folder.resolve()))
        if isinstance(value, str)
        else value
        for path, value in router_settings(bus).items()
    }
    settings = _nested(moved) | {"access_control": access_control(ROLES)}
    file = folder.resolve() / ROUTER / ROUTER_SETTINGS
    return _HEADING.format(file=file) + json.dumps(settings, indent=2) + "\n"


def _nested(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings by their paths, ``{"listen/endpoints": …}``, as tables in tables."""
    nested: dict[str, Any] = {}
    for path, value in settings.items():
        *sections, name = path.split("/")
        table = nested
        for section in sections:
            table = table.setdefault(section, {})
        table[name] = value
    return nested
