from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path

import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.verification import PolicyBuilder, Store, VerificationError

from placefield.errors import ConfigError
from placefield_tools.security.folders import write_credentials

ROLES = {
    "router",
    "featurizer",
    "describer",
    "channel",
    "fuser",
    "verifier",
    "camera",
    "dashboard",
    "mapserver",
    "mapper",
}
HOSTS = ["robot.example", "10.0.0.7", "localhost", "robot.example"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("security") / "pki"
    write_credentials(folder, HOSTS, days=100)
    return folder


def certificate(file: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(file.read_bytes())


def policy(made: Path) -> PolicyBuilder:
    return PolicyBuilder().store(Store([certificate(made / "ca.pem")]))


def test_there_is_a_folder_for_each_role_with_all_that_it_needs(made: Path) -> None:
    assert {path.name for path in made.iterdir()} == ROLES | {"ca.pem", "ca-key.pem"}
    for role in ROLES:
        files = {"ca.pem", "certificate.pem", "key.pem"}
        files |= {"router.json5"} if role == "router" else set()
        assert {path.name for path in (made / role).iterdir()} == files
        assert (made / role / "ca.pem").read_bytes() == (made / "ca.pem").read_bytes()


def test_keys_can_be_read_by_their_owner_alone(made: Path) -> None:
    keys = [made / "ca-key.pem", *(made / role / "key.pem" for role in ROLES)]
    assert {key.stat().st_mode & 0o777 for key in keys} == {0o600}
    assert made.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("role", sorted(ROLES))
def test_a_certificate_is_its_roles_for_as_long_as_was_asked(made: Path, role: str) -> None:
    own = certificate(made / role / "certificate.pem")
    assert own.subject.rfc4514_string() == f"CN={role}"
    policy(made).build_client_verifier().verify(own, [])
    public = own.public_key()
    assert isinstance(public, ec.EllipticCurvePublicKey)
    assert isinstance(public.curve, ec.SECP256R1)
    left = own.not_valid_after_utc - datetime.now(UTC)
    assert timedelta(days=99) < left <= timedelta(days=100)


def test_the_routers_is_for_loopback_and_the_hosts_that_were_named_and_no_other(made: Path) -> None:
    own = certificate(made / "router" / "certificate.pem")
    for name in ("localhost", "robot.example"):
        policy(made).build_server_verifier(x509.DNSName(name)).verify(own, [])
    for address in ("127.0.0.1", "10.0.0.7"):
        subject = x509.IPAddress(IPv4Address(address))
        policy(made).build_server_verifier(subject).verify(own, [])
    with pytest.raises(VerificationError):
        policy(made).build_server_verifier(x509.DNSName("other.example")).verify(own, [])


@pytest.mark.parametrize("role", sorted(ROLES - {"router"}))
def test_no_other_role_can_pass_for_a_router(made: Path, role: str) -> None:
    uses = certificate(made / role / "certificate.pem").extensions.get_extension_for_class(
        x509.ExtendedKeyUsage
    )
    assert list(uses.value) == [x509.ExtendedKeyUsageOID.CLIENT_AUTH]


@pytest.mark.parametrize(("hosts", "address"), [([], "127.0.0.1"), (["10.0.0.7"], "0.0.0.0")])
def test_the_routers_settings_are_zenohs_and_listen_where_it_was_reported(
    tmp_path: Path, hosts: list[str], address: str
) -> None:
    write_credentials(tmp_path / "pki", hosts, days=1)
    settings = zenoh.Config.from_file(tmp_path / "pki" / "router" / "router.json5")
    assert settings.get_json("listen/endpoints") == f'["tls/{address}:7557"]'
    assert settings.get_json("access_control/default_permission") == '"deny"'
    assert settings.get_json("access_control/enabled") == "true"
    assert settings.get_json("transport/link/tls/enable_mtls") == "true"
    assert settings.get_json("scouting/multicast/enabled") == "false"


def test_what_is_there_is_never_written_over(made: Path, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in made.rglob("*") if path.is_file()}
    file = tmp_path / "file"
    file.touch()
    for taken in (made, file):
        with pytest.raises(ConfigError, match=f"{taken}: there is something"):
            write_credentials(taken, [], days=1)
    assert {path: path.read_bytes() for path in made.rglob("*") if path.is_file()} == before


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    write_credentials(tmp_path, [], days=1)
    assert (tmp_path / "camera" / "key.pem").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("host", ["", "two words", "tls/robot:7557", "-a", "a..b", "*", "räuber"])
def test_a_malformed_host_is_refused_and_nothing_is_written(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigError, match=r"--host .*: write a name"):
        write_credentials(tmp_path / "pki", [host], days=1)
    assert not any(tmp_path.iterdir())
