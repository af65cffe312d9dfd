"""The registry of public benchmarks, ``benchmarks.toml``, read and checked."""

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import PurePosixPath
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from placefield.errors import ConfigError

TRUTH = "truth.csv"
"""Name of the ground truth in the benchmark's folder, converted from the benchmark's own."""

_ARCHIVES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


class BenchmarkTraverse(_Entry):
    """One drive along the route.

    Attributes:
        name: of the traverse.
        folder: the folder of its frames (or its video), within the benchmark's folder.
        frames: number of frames; None if unknown.
    """

    name: str
    folder: str
    frames: int | None = None


class File(_Entry):
    """A file to download; an archive is unpacked.

    Attributes:
        name: of the file, relative to ``Benchmark.files_at``.
        sha256: of its bytes; None if unknown.
        bytes: its length; None if unknown.
        into: folder within the benchmark's folder that an archive becomes; ".": the folder itself.
    """

    name: str
    sha256: Sha256 | None = None
    bytes: int | None = None
    into: str = "."

    @property
    def is_archive(self) -> bool:
        """Whether the file is an archive, which is unpacked."""
        return self.name.endswith(_ARCHIVES)


class BenchmarkStudy(_Entry):
    """How the benchmark is run here.

    Attributes:
        reference: name of the traverse of the map.
        query: name of the traverse that is matched.
        tolerance: frames; None if there is a file of the ground truth.
    """

    reference: str
    query: str
    tolerance: int | None = None


class GpsTruth(_Entry):
    """A ground truth by GPS.

    Attributes:
        file: the file beside each traverse with the position of every frame.
        metres: default for the largest distance of a right place.
    """

    file: str
    metres: Annotated[float, Field(gt=0)]


class Benchmark(_Entry):
    """A public benchmark.

    Attributes:
        name: its name in commands.
        title: the authors' name.
        about: the place and the conditions.
        citation: publication to cite.
        licence: as text, also if it is unknown.
        page: address of its page.
        size: of the download, as text.
        tolerance: the usual tolerance, as text.
        truth: source of the ground truth, as text.
        notes: further notes.
        traverses: as they lie in its folder.
        study: how to run it here; None if it is no drive along a route.
        truth_matrix: file with its ground truth as a matrix, which is converted to ``TRUTH``.
        truth_gps: positions that are converted to ``TRUTH`` on request.
        files_at: base address of ``files``.
        files: files to download; empty if a program cannot or may not download them.
        by_hand: instructions for a download by hand.
    """

    name: str
    title: str
    about: str
    citation: str
    licence: str
    page: str
    size: str
    tolerance: str
    truth: str
    notes: str = ""
    traverses: Annotated[tuple[BenchmarkTraverse, ...], Field(strict=False)] = ()
    study: BenchmarkStudy | None = None
    truth_matrix: str | None = None
    truth_gps: GpsTruth | None = None
    files_at: str | None = None
    files: Annotated[tuple[File, ...], Field(strict=False)] = ()
    by_hand: str | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [traverse.name for traverse in self.traverses]
        if self.study and not {self.study.reference, self.study.query} <= set(names):
            raise ValueError("the study uses a traverse that does not exist")
        if bool(self.files) == bool(self.by_hand) or bool(self.files) != bool(self.files_at):
            raise ValueError("give files and files_at, or by_hand")
        if self.truth_gps and (
            self.truth_matrix or not self.study or self.study.tolerance is not None
        ):
            raise ValueError("truth_gps is the truth of a study, and the only one")
        return self

    @property
    def gps_files(self) -> tuple[tuple[str, str], ...]:
        """Paths of the study's reference and query, each with its file of positions.

        Empty if the truth is not by GPS.
        """
        if self.truth_gps is None or self.study is None:
            return ()
        traverses = [self.folder_of(name) for name in (self.study.reference, self.study.query)]
        beside = [str(PurePosixPath(path).with_name(self.truth_gps.file)) for path in traverses]
        return tuple(zip(traverses, beside, strict=True))

    def folder_of(self, traverse: str) -> str:
        """Return the folder of a traverse within the benchmark's."""
        return next(known.folder for known in self.traverses if known.name == traverse)


@cache
def benchmarks() -> Mapping[str, Benchmark]:
    """Return all benchmarks of the registry, by name."""
    text = files(__package__).joinpath("benchmarks.toml").read_text(encoding="utf-8")
    return {
        name: Benchmark.model_validate({"name": name, **entry})
        for name, entry in tomllib.loads(text).items()
    }


def benchmark(name: str) -> Benchmark:
    """Return a benchmark by its name.

    Raises:
        ConfigError: there is no benchmark of this name.
    """
    known = benchmarks()
    if name not in known:
        close = get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]}?" if close else "'placefield datasets' lists the names"
        raise ConfigError(f"{name}: unknown benchmark; {hint}")
    return known[name]
