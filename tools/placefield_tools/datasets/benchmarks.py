"""What is known of each public benchmark: the registry ``benchmarks.toml``, read and checked."""

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
"""What a ground truth that is made of the benchmark's own is called, in the benchmark's folder."""

_ARCHIVES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


class BenchmarkTraverse(_Entry):
    """One drive along the route.

    Attributes:
        name: what it is called.
        folder: its frames' folder (or its video), within the benchmark's folder.
        frames: how many; None where it is not known.
    """

    name: str
    folder: str
    frames: int | None = None


class File(_Entry):
    """A file to be downloaded; an archive is unpacked.

    Attributes:
        name: of the file, after the address that all files share.
        sha256: of its bytes; None where that is not known.
        bytes: how long it is; None where that is not known.
        into: for an archive, the folder within the benchmark's that it becomes; ".": that itself.
    """

    name: str
    sha256: Sha256 | None = None
    bytes: int | None = None
    into: str = "."

    @property
    def is_archive(self) -> bool:
        """Whether it is unpacked."""
        return self.name.endswith(_ARCHIVES)


class BenchmarkStudy(_Entry):
    """How the benchmark is run here.

    Attributes:
        reference: name of the traverse that is mapped.
        query: name of the one that is matched.
        tolerance: frames; None where a ground truth says what is right.
    """

    reference: str
    query: str
    tolerance: int | None = None


class GpsTruth(_Entry):
    """A ground truth by GPS.

    Attributes:
        file: the file beside each traverse that has the position of every frame.
        metres: how far off a right place is at most, unless one asks for another distance.
    """

    file: str
    metres: Annotated[float, Field(gt=0)]


class Benchmark(_Entry):
    """A public benchmark.

    Attributes:
        name: what commands call it.
        title: what its authors call it.
        about: where, and in which conditions.
        citation: whom to cite.
        licence: in words; what is not known is said to be.
        page: address of its page.
        size: of what is downloaded, in words.
        tolerance: in words, what others take.
        truth: in words, what says which place is right.
        notes: what else to know.
        traverses: as they lie in its folder.
        study: how to run it here; None where it is no drive along a route.
        truth_matrix: the file with its ground truth as a matrix, from which ``TRUTH`` is made.
        truth_gps: where the positions are from which ``TRUTH`` is made when one asks for it.
        files_at: address that the names of ``files`` come after.
        files: what to download; empty where it cannot, or may not, be downloaded by a program.
        by_hand: what to do instead.
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
            raise ValueError("the study takes a traverse that there is not")
        if bool(self.files) == bool(self.by_hand) or bool(self.files) != bool(self.files_at):
            raise ValueError("give files and files_at, or by_hand")
        if self.truth_gps and (
            self.truth_matrix or not self.study or self.study.tolerance is not None
        ):
            raise ValueError("truth_gps is the truth of a study, and the only one")
        return self

    @property
    def gps_files(self) -> tuple[tuple[str, str], ...]:
        """The study's reference and query, each with its positions, within the folder.

        Empty where the truth is not by GPS.
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
    """Return all that are known, by name."""
    text = files(__package__).joinpath("benchmarks.toml").read_text(encoding="utf-8")
    return {
        name: Benchmark.model_validate({"name": name, **entry})
        for name, entry in tomllib.loads(text).items()
    }


def benchmark(name: str) -> Benchmark:
    """Return a benchmark by its name.

    Raises:
        ConfigError: there is none of that name.
    """
    known = benchmarks()
    if name not in known:
        close = get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]}?" if close else "'placefield datasets' lists the names"
        raise ConfigError(f"{name}: no benchmark of that name is known; {hint}")
    return known[name]
