"""Unpacking untrusted archives: only into the folder, and only if the disk has enough room."""

import lzma
import shutil
import stat
import struct
import tarfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PureWindowsPath
from typing import IO
from zipfile import BadZipFile, ZipFile

from placefield.errors import SourceError

_DAMAGES = (
    BadZipFile,
    EOFError,
    RuntimeError,  # it has a password, or an unknown compression
    ValueError,
    lzma.LZMAError,
    struct.error,
    tarfile.TarError,
    zlib.error,
)
"""What reading a damaged archive raises."""

_FORKS = "__MACOSX"
"""A folder that some systems put beside the content."""


@dataclass(frozen=True, slots=True)
class _Member:
    """An entry of an archive.

    Attributes:
        name: path in the archive.
        size: bytes, as declared; no more are ever read.
        is_folder: whether it is a folder.
        is_file: whether it is a regular file: no link, device or pipe.
        open: opens its content.
    """

    name: str
    size: int
    is_folder: bool
    is_file: bool
    open: Callable[[], IO[bytes]]


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a zip, or a tar of any compression.

    Args:
        archive: the file.
        folder: to be created; if the archive holds a single folder, that becomes this folder.

    Raises:
        SourceError: the archive is damaged, holds links or paths outside the folder, or more than
            the disk has room for; no file of it is left then.
        OSError: a file cannot be written.
    """
    wrapped = folder.with_name(f"{folder.name}.unpacking")
    shutil.rmtree(wrapped, ignore_errors=True)
    wrapped.mkdir(parents=True)
    try:
        _unpack(archive, wrapped)
        _content(wrapped).rename(folder)
    except _DAMAGES as error:
        raise SourceError(f"{archive}: is damaged ({error}); remove it and get it again") from None
    finally:
        shutil.rmtree(wrapped, ignore_errors=True)


def _unpack(archive: Path, folder: Path) -> None:
    room = shutil.disk_usage(folder).free
    for member in _members(archive):
        room -= member.size
        if room < 0:
            raise SourceError(
                f"{archive}: holds more than the disk has room for, at {member.name!r}; "
                "free some space, or choose another folder with --into"
            )
        _write(member, folder, archive)


def _write(member: _Member, folder: Path, archive: Path) -> None:
    path = PureWindowsPath(member.name)  # handles drives, and both slashes
    if path.anchor or ".." in path.parts:
        raise SourceError(f"{archive}: {member.name!r} would land outside the folder: not unpacked")
    if not (member.is_folder or member.is_file):
        raise SourceError(f"{archive}: {member.name!r} is a link or a device: not unpacked")
    if path.parts[:1] == (_FORKS,):
        return
    target = folder.joinpath(*path.parts)
    if member.is_folder:
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with member.open() as source, target.open("xb") as file:
        shutil.copyfileobj(source, file)


def _members(archive: Path) -> Iterator[_Member]:
    return _of_zip(archive) if archive.suffix == ".zip" else _of_tar(archive)


def _of_zip(archive: Path) -> Iterator[_Member]:
    with ZipFile(archive) as opened:
        for info in opened.infolist():
            kind = stat.S_IFMT(info.external_attr >> 16)  # 0 if the packer stores no kind
            yield _Member(
                info.filename,
                info.file_size,
                is_folder=info.filename.endswith("/"),
                is_file=kind in (0, stat.S_IFREG),
                open=partial(opened.open, info),
            )


def _of_tar(archive: Path) -> Iterator[_Member]:
    with tarfile.open(archive) as opened:
        for info in opened:
            yield _Member(
                info.name,
                info.size,
                is_folder=info.isdir(),
                is_file=info.isfile(),
                open=partial(_bytes_of, opened, info),
            )


def _bytes_of(opened: tarfile.TarFile, info: tarfile.TarInfo) -> IO[bytes]:
    source = opened.extractfile(info)
    assert source is not None, "a regular file"
    return source


def _content(folder: Path) -> Path:
    """Return the folder, or the innermost folder if each holds only one folder."""
    entries = list(folder.iterdir())
    return _content(entries[0]) if len(entries) == 1 and entries[0].is_dir() else folder
