"""The credentials of a process on the bus: a folder of PEM files.

``ca.pem`` is the certificate authority that all processes of a bus trust. ``certificate.pem`` and
``key.pem`` belong to the process. A router's folder also holds ``router.json5``, which says what
each role may do. TLS checks the certificates, but does not report why it refuses them; the checks
here do.
"""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import zenoh

from placefield.config import BusConfig
from placefield.errors import BusError

AUTHORITY = "ca.pem"
CERTIFICATE = "certificate.pem"
KEY = "key.pem"
ROUTER_SETTINGS = "router.json5"

_REMEDY = "make new ones with 'placefield security init'"


def encryption(config: BusConfig) -> dict[str, Any]:
    """Return Zenoh's settings for encryption with the credentials; {} without credentials.

    With credentials every endpoint must be encrypted; without, none may be.

    Raises:
        BusError: an endpoint does not match, or the credentials are damaged, expired or do not fit.
    """
    for endpoint in (config.endpoint, *config.connect):
        is_encrypted = endpoint.startswith(("tls/", "quic/"))
        if is_encrypted and config.credentials is None:
            raise BusError(f"endpoint {endpoint}: needs --credentials FOLDER")
        if config.credentials is not None and not is_encrypted:
            raise BusError(f"endpoint {endpoint}: with credentials, write it as tls/HOST:PORT")
    return {} if config.credentials is None else tls_settings(Path(config.credentials))


def access_control(folder: Path) -> Any:
    """Return the section ``access_control`` of ``router.json5`` in a router's folder.

    Raises:
        BusError: the file is missing or malformed.
    """
    file = folder / ROUTER_SETTINGS
    try:
        return json.loads(zenoh.Config.from_file(file).get_json("access_control"))
    except zenoh.ZError:
        raise BusError(
            f"{file}: missing or malformed; a router needs the folder 'router' that "
            "'placefield security init' makes"
        ) from None


def tls_settings(folder: Path) -> dict[str, Any]:
    """Return Zenoh's settings for mutual TLS with the credentials of a folder, by setting path.

    Raises:
        BusError: a file is missing or no PEM, the certificate has expired, or the key does not
            belong to the certificate.
    """
    _check(folder)
    authority, certificate, key = (
        str(folder.resolve() / file) for file in (AUTHORITY, CERTIFICATE, KEY)
    )
    own = {
        "root_ca_certificate": authority,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    return {f"transport/link/tls/{name}": value for name, value in own.items()}


def _check(folder: Path) -> None:
    # cryptography is slow to import, and needed only with credentials.
    from cryptography.hazmat.primitives.serialization import load_pem_private_key
    from cryptography.x509 import load_pem_x509_certificate

    pem = {file: _read(folder / file) for file in (AUTHORITY, CERTIFICATE, KEY)}
    certificates = {}
    for file in (AUTHORITY, CERTIFICATE):
        try:
            certificates[file] = load_pem_x509_certificate(pem[file])
        except ValueError:
            raise BusError(f"{folder / file}: not a certificate in PEM format; {_REMEDY}") from None
    try:
        key = load_pem_private_key(pem[KEY], password=None)
    except (ValueError, TypeError):  # another format; a password
        raise BusError(
            f"{folder / KEY}: not a key in PEM format without a password; {_REMEDY}"
        ) from None
    if key.public_key() != certificates[CERTIFICATE].public_key():
        raise BusError(f"{folder / KEY}: not the key of {CERTIFICATE}; copy both from one role")
    now = datetime.now(UTC)
    for file, certificate in certificates.items():
        if now > certificate.not_valid_after_utc:
            end = certificate.not_valid_after_utc
            raise BusError(f"{folder / file}: expired on {end:%Y-%m-%d}; {_REMEDY}")
        if now < certificate.not_valid_before_utc:
            start = certificate.not_valid_before_utc
            raise BusError(
                f"{folder / file}: valid only from {start:%Y-%m-%d}; check this host's clock"
            )


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise BusError(
            f"{file}: {error.strerror}; give --credentials the folder of one role, made by "
            "'placefield security init'"
        ) from None
