"""Downloading a file: an interrupted download is resumed, unless the file has changed.

``pooch`` downloads files and checks their sums, but restarts each at its first byte. The archive of
a benchmark may be large, and the link may break.
"""

import http.client
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

from placefield.errors import SourceError

Progress = Callable[[int, int | None], None]
"""Called with the bytes received so far, and the total; None if the server does not report it."""

_BLOCK = 1 << 18
_TIMEOUT_S = 30.0
_CONTENT_RANGE = re.compile(r"bytes (?:(\d+)-\d+|\*)/(\d+|\*)")
_RANGE_IS_BEYOND = 416


class _CutOffError(Exception):
    """The connection broke, or the server cannot be reached."""


def download(url: str, part: Path, size: int | None, progress: Progress) -> None:
    """Download a file completely, and resume as long as bytes arrive.

    The version that the server reported (a strong ETag, or else a date) is stored beside the file.
    The server resumes only this version, and sends another version from its beginning.

    Args:
        url: http or https.
        part: path of the file; received bytes stay there in any case.
        size: expected length, bytes; None if unknown.
        progress: called with the progress.

    Raises:
        SourceError: the file cannot be downloaded completely.
        OSError: the file cannot be written.
    """
    while True:
        had = _size(part)
        try:
            _go_on(url, part, size, progress)
        except _CutOffError as cut:
            if _size(part) > had:
                continue
            raise SourceError(f"{url}: {cut}; run the same command again to go on") from None
        return


def _go_on(url: str, part: Path, size: int | None, progress: Progress) -> None:
    had = _size(part)
    with _answer(url, part, had) as answer:
        start, total = _extent(answer, had)
        if start is None:  # the server has nothing to add
            if total == had:
                return
            part.unlink(missing_ok=True)
            raise _CutOffError("sends another range than requested; the download restarts")
        if size is not None and total not in (None, size):
            raise SourceError(f"{url}: has changed: it has {total} bytes instead of {size}")
        _check_room(part, start, total)
        with part.open("ab" if start else "wb") as file:  # emptied before its version is noted
            _note_version(part, answer)
            for block in _blocks(answer):
                file.write(block)
                start += len(block)
                progress(start, total)
    if total is not None and start < total:
        raise _CutOffError(f"was cut off after {start} of {total} bytes")


@contextmanager
def _answer(url: str, part: Path, had: int) -> Iterator[http.client.HTTPResponse | HTTPError]:
    request = Request(url, headers={"User-Agent": "placefield"})
    version = _version_file(part)
    if had and version.is_file():
        request.add_header("Range", f"bytes={had}-")
        request.add_header("If-Range", version.read_text(encoding="latin-1"))
    try:
        answer = urlopen(request, timeout=_TIMEOUT_S)
    except HTTPError as error:
        if error.code != _RANGE_IS_BEYOND:
            raise SourceError(
                f"{url}: the server answers {error.code} {error.reason}; "
                "its page may say where it is now"
            ) from None
        answer = error
    except (OSError, http.client.HTTPException) as error:
        raise _CutOffError(f"cannot be reached ({getattr(error, 'reason', error)})") from None
    with answer:
        yield answer


def _extent(
    answer: http.client.HTTPResponse | HTTPError, had: int
) -> tuple[int | None, int | None]:
    """Return the offset of the answer's first byte (None: no bytes), and the file's length."""
    stated = _CONTENT_RANGE.fullmatch(answer.headers.get("Content-Range", ""))
    length = answer.headers.get("Content-Length", "")
    if answer.status == http.client.OK:
        return 0, int(length) if length.isdecimal() else None
    if stated and answer.status == http.client.PARTIAL_CONTENT and stated[1] == str(had):
        return had, int(stated[2]) if stated[2] != "*" else None
    if stated and answer.status == _RANGE_IS_BEYOND and stated[2] != "*":
        return None, int(stated[2])
    return None, None


def _blocks(answer: http.client.HTTPResponse | HTTPError) -> Iterator[bytes]:
    while True:
        try:
            block = answer.read(_BLOCK)
        except (OSError, http.client.HTTPException) as error:
            raise _CutOffError(f"was cut off ({error})") from None
        if not block:
            return
        yield block


def _note_version(part: Path, answer: http.client.HTTPResponse | HTTPError) -> None:
    tag = answer.headers.get("ETag", "")
    is_strong = tag.startswith('"')  # a weak one stands for bytes that may differ
    version = tag if is_strong else answer.headers.get("Last-Modified", "")
    if version:
        _version_file(part).write_text(version, encoding="latin-1")
    else:
        _version_file(part).unlink(missing_ok=True)


def _check_room(part: Path, start: int, total: int | None) -> None:
    free = shutil.disk_usage(part.parent).free
    if total is not None and total - start > free:
        raise SourceError(
            f"{part}: {(total - start) >> 20} MiB are still missing, and the disk has "
            f"{free >> 20} MiB free; free some space, or choose another folder with --into"
        )


def _version_file(part: Path) -> Path:
    return part.with_name(f"{part.name}.version")


def _size(part: Path) -> int:
    return part.stat().st_size if part.is_file() else 0
