import logging
import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from shutil import copytree

import pytest

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.credentials import tls_settings
from placefield.config import BusConfig
from placefield.errors import BusError
from placefield_tools.security.certificates import issue, make_authority
from placefield_tools.security.folders import write_credentials

TLS = "tls/127.0.0.1:7557"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("credentials") / "made"
    write_credentials(folder, [], days=30)
    return folder


@pytest.fixture
def camera(made: Path, tmp_path: Path) -> Path:
    """A copy of a role's folder, to be spoilt."""
    return copytree(made / "camera", tmp_path / "camera")


def refusal(folder: Path) -> str:
    with pytest.raises(BusError) as refused:
        tls_settings(folder)
    message = str(refused.value)
    assert "\n" not in message
    return message


def test_both_sides_show_certificates_and_names_and_dates_are_checked(made: Path) -> None:
    settings = tls_settings(made / "camera")
    for check in ("enable_mtls", "verify_name_on_connect", "close_link_on_expiration"):
        assert settings[f"transport/link/tls/{check}"] is True
    assert settings["transport/link/tls/root_ca_certificate"] == str(made / "camera" / "ca.pem")


def test_files_are_named_in_full_wherever_the_command_runs(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made)
    assert tls_settings(Path("camera")) == tls_settings(made / "camera")


@pytest.mark.parametrize("file", ["ca.pem", "certificate.pem", "key.pem"])
def test_a_file_that_is_missing_or_no_pem_is_named(camera: Path, file: str) -> None:
    (camera / file).write_bytes(b"\xff no PEM")
    assert f"{camera / file}: not a " in refusal(camera)
    (camera / file).unlink()
    assert f"{camera / file}: No such file" in refusal(camera)


def test_a_folder_of_no_credentials_is_named(made: Path, tmp_path: Path) -> None:
    assert "give --credentials the folder of one role" in refusal(tmp_path)
    assert f"{made / 'certificate.pem'}: No such file" in refusal(made)


def test_a_key_of_another_certificate_is_refused(made: Path, camera: Path) -> None:
    (camera / "key.pem").write_bytes((made / "fuser" / "key.pem").read_bytes())
    assert f"{camera / 'key.pem'}: not the key of certificate.pem" in refusal(camera)


def expire(folder: Path) -> str:
    authority = make_authority("another", days=9)
    expired = issue(authority, "camera", days=-2)
    (folder / "certificate.pem").write_bytes(expired.certificate_pem)
    (folder / "key.pem").write_bytes(expired.key_pem)
    return f"expired on {datetime.now(UTC) - timedelta(days=2):%Y-%m-%d}; make new ones with"


def expire_authority(folder: Path) -> str:
    (folder / "ca.pem").write_bytes(make_authority("another", days=-2).certificate_pem)
    return f"{folder / 'ca.pem'}: expired on"


@pytest.mark.parametrize("spoil", [expire, expire_authority])
def test_an_expired_certificate_is_refused_with_its_date(
    camera: Path, spoil: Callable[[Path], str]
) -> None:
    assert spoil(camera) in refusal(camera)


def test_a_certificate_of_the_future_hints_at_the_clock(
    camera: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Early(datetime):
        @classmethod
        def now(cls, tz: object = None) -> datetime:
            return datetime(1970, 1, 1, tzinfo=UTC)

    monkeypatch.setattr("placefield.bus.credentials.datetime", Early)
    assert "check this host's clock" in refusal(camera)


@pytest.mark.parametrize("opener", [open_bus, open_router])
def test_credentials_and_tls_come_together(made: Path, opener: Callable[..., object]) -> None:
    router = str(made / "router")
    for config, reason in (
        (BusConfig(endpoint=TLS), f"{TLS}: needs --credentials FOLDER"),
        (BusConfig(credentials=router), "with credentials, write it as tls/"),
        (
            BusConfig(
                endpoint=TLS, connect=("tcp/10.0.0.7:7557",), credentials=str(made / "router")
            ),
            "tcp/10.0.0.7:7557: with credentials",
        ),
    ):
        with pytest.raises(BusError, match=reason):
            opener(config).__enter__()  # type: ignore[attr-defined]


def test_a_router_without_access_control_does_not_open(made: Path, tmp_path: Path) -> None:
    folder = copytree(made / "router", tmp_path / "router")
    for spoil in (lambda file: file.write_text("{"), os.unlink):
        spoil(folder / "router.json5")
        with pytest.raises(BusError, match=r"router\.json5: .*the folder 'router'") as refused:
            open_router(BusConfig(endpoint=TLS, credentials=str(folder))).__enter__()
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("address", "warns"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_a_router_exposed_without_credentials_logs_a_warning(
    endpoint: str, caplog: pytest.LogCaptureFixture, address: str, warns: bool
) -> None:
    elsewhere = endpoint.replace("127.0.0.1", address)
    with caplog.at_level(logging.WARNING), open_router(BusConfig(endpoint=elsewhere)):
        pass
    assert [
        f"{elsewhere}: any client that reaches it may read" in line for line in caplog.messages
    ] == [True] * warns
