"""Credentials as folders: one for each role, to be copied to the hosts that play it."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from placefield.bus.credentials import AUTHORITY, CERTIFICATE, KEY, ROUTER_SETTINGS
from placefield.bus.settings import router_settings
from placefield.config import BusConfig
from placefield.errors import ConfigError
from placefield_tools.security.access import access_control
from placefield_tools.security.certificates import Certified, issue, make_authority
from placefield_tools.security.roles import ROLES, ROUTER

AUTHORITY_KEY = "ca-key.pem"
_PORT = BusConfig().endpoint.rpartition(":")[2]
_LOCAL = ("localhost", "127.0.0.1", "::1")

_HEADING = """\
// A router that lets in who has a certificate, to do what its role may do and nothing else.
// A stock router takes all of it, with 'zenohd --config {file}';
// change the paths in it where the folder has moved. 'placefield up --credentials' takes the access
// control alone.
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
    _make_empty(folder)
    _write_secret(folder / AUTHORITY_KEY, authority.key_pem)
    (folder / AUTHORITY).write_bytes(authority.certificate_pem)
    for role, certified in issued.items():
        _write_role(folder / role, authority, certified)
    _write_router_settings(folder / ROUTER, "0.0.0.0" if hosts else "127.0.0.1")
    return list(issued)


def _make_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: there is something; credentials are written to a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)


def _write_role(folder: Path, authority: Certified, certified: Certified) -> None:
    folder.mkdir()
    (folder / AUTHORITY).write_bytes(authority.certificate_pem)
    (folder / CERTIFICATE).write_bytes(certified.certificate_pem)
    _write_secret(folder / KEY, certified.key_pem)


def _write_secret(file: Path, secret: bytes) -> None:
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as opened:
        opened.write(secret)


def _write_router_settings(folder: Path, address: str) -> None:
    bus = BusConfig(endpoint=f"tls/{address}:{_PORT}", credentials=str(folder))
    settings = _nested(router_settings(bus)) | {"access_control": access_control(ROLES)}
    file = folder.resolve() / ROUTER_SETTINGS
    file.write_text(_HEADING.format(file=file) + json.dumps(settings, indent=2) + "\n")


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
