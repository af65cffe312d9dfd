"""Downloads from a server on this machine that cuts off, changes or knows less."""

import errno
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.error import URLError

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from placefield.errors import SourceError
from placefield_tools.datasets import downloading
from placefield_tools.datasets.downloading import download

BODY = np.random.default_rng(1).bytes(700_000)


def ignore(there: int, total: int | None) -> None:
    pass


@pytest.fixture
def part(tmp_path: Path) -> Path:
    return tmp_path / "file.part"


def test_a_file_comes_whole_and_its_progress_is_reported(web: Any, part: Path) -> None:
    web.content["/file"] = BODY
    reported: list[tuple[int, int | None]] = []
    download(f"{web.url}/file", part, len(BODY), lambda *there: reported.append(there))
    assert part.read_bytes() == BODY
    assert reported[-1] == (len(BODY), len(BODY))
    assert [there for there, _ in reported] == sorted(there for there, _ in reported)


def test_a_file_that_is_cut_off_goes_on_and_no_byte_is_sent_twice(web: Any, part: Path) -> None:
    web.content["/file"] = BODY
    web.cuts = [300_000, 1, 250_000]
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == BODY
    assert web.sent["/file"] == len(BODY)
    assert web.ranges == [None, "bytes=300000-", "bytes=300001-", "bytes=550001-"]


def test_one_that_was_given_up_goes_on_the_next_time(web: Any, part: Path) -> None:
    web.content["/file"] = BODY
    web.cuts = [400_000, 0]
    with pytest.raises(SourceError, match="cut off after 400000 of 700000 bytes; run the same"):
        download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == BODY[:400_000]
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == BODY
    assert web.sent["/file"] == len(BODY)


def test_one_that_had_come_in_full_is_not_sent_again(web: Any, part: Path) -> None:
    web.content["/file"] = BODY
    download(f"{web.url}/file", part, None, ignore)
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == BODY
    assert web.sent["/file"] == len(BODY)


@pytest.mark.parametrize("new", [BODY[::-1], BODY[:1000], BODY + b"more"])
def test_one_that_has_changed_begins_anew(web: Any, part: Path, new: bytes) -> None:
    web.content["/file"] = BODY
    web.cuts = [400_000, 0]
    with pytest.raises(SourceError):
        download(f"{web.url}/file", part, None, ignore)
    web.content["/file"] = new
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == new


@pytest.mark.parametrize("missing", ["knows_ranges", "knows_versions"])
def test_a_server_that_knows_less_sends_it_from_the_beginning(
    web: Any, part: Path, missing: str
) -> None:
    setattr(web, missing, False)
    web.content["/file"] = BODY
    web.cuts = [400_000]
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == BODY
    assert web.sent["/file"] == len(BODY) + 400_000


def test_a_server_that_always_stops_at_the_same_byte_is_given_up(web: Any, part: Path) -> None:
    web.knows_ranges = False
    web.content["/file"] = BODY
    web.cuts = [400_000] * 9
    with pytest.raises(SourceError, match="cut off"):
        download(f"{web.url}/file", part, None, ignore)
    assert len(web.ranges) == 2


def test_what_is_not_there_is_reported_with_what_the_server_says(web: Any, part: Path) -> None:
    with pytest.raises(SourceError, match=r"/file: the server answers 404 Not Found; "):
        download(f"{web.url}/file", part, None, ignore)
    assert not part.exists()


def test_a_server_that_cannot_be_reached_is_reported(
    part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise URLError("Name or service not known")

    monkeypatch.setattr(downloading, "urlopen", fail)
    with pytest.raises(SourceError, match=r"cannot be reached \(Name or service not known\)"):
        download("http://nowhere.invalid/file", part, None, ignore)


def test_a_file_of_another_length_than_known_is_not_begun(web: Any, part: Path) -> None:
    web.content["/file"] = BODY
    with pytest.raises(SourceError, match="has changed: it has 700000 bytes instead of 5"):
        download(f"{web.url}/file", part, 5, ignore)
    assert not part.exists()


def test_a_file_that_is_larger_than_the_room_is_not_begun(
    web: Any, part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    web.content["/file"] = BODY
    usage = shutil.disk_usage(part.parent)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(SourceError, match="disk has 0 MiB free; free some space"):
        download(f"{web.url}/file", part, None, ignore)
    assert not part.exists()


def test_what_came_before_the_disk_was_full_is_gone_on_with(
    web: Any, part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    web.content["/file"] = BODY

    def full_after(limit: int) -> Callable[[int, int | None], None]:
        def reported(there: int, _: int | None) -> None:
            if there > limit:
                raise OSError(errno.ENOSPC, "No space left on device")

        return reported

    with pytest.raises(OSError, match="No space left"):
        download(f"{web.url}/file", part, None, full_after(400_000))
    assert 0 < part.stat().st_size < len(BODY)
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == BODY


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(body=st.binary(max_size=60), cuts=st.lists(st.integers(1, 30), max_size=5))
def test_wherever_it_is_cut_off_the_same_bytes_arrive(
    web: Any, part: Path, body: bytes, cuts: list[int]
) -> None:
    for file in part.parent.iterdir():
        file.unlink()
    web.content["/file"], web.cuts, web.sent = body, list(cuts), {}
    download(f"{web.url}/file", part, None, ignore)
    assert part.read_bytes() == body
    assert web.sent["/file"] == len(body)
