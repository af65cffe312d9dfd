"""How the steps of a build are carried out: on which cores, with progress, and only once.

A build of many places takes long. Its finished steps may be kept in a folder, so that a build that
was killed does not do them again. A step has the result of the same inputs only.
"""

import hashlib
import logging
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from placefield.files import written_whole

log = logging.getLogger(__name__)

Item = TypeVar("Item")
Result = TypeVar("Result")
Arrays = tuple[NDArray[Any], ...]

Share = Callable[[float], None]
"""Called with the fraction of a step that is done, from any thread."""

Progress = Callable[[int | None, str, float], None]
"""Called with a channel's number, the step under way and the fraction done, from any thread.

A step of all channels has no number. An exception that it raises ends the build.
"""


class Run(Protocol):
    """Applies a function to all channels: ``map``, or a similar function on several cores."""

    def __call__(
        self, function: Callable[[Item], Result], items: Iterable[Item], /
    ) -> Iterable[Result]:
        """Return the results in the order of the items."""


@dataclass(frozen=True)
class Steps:
    """How the steps of a build are carried out.

    Attributes:
        run: applies a function to all channels, which do not depend on each other, so that the
            number of cores does not change the result.
        progress: receives the progress of each step.
        folder: where finished steps are kept; None: they are not. It need not exist.
        inputs: the digest of all that the steps compute from.
    """

    run: Run = map
    progress: Progress = lambda number, what, share: None
    folder: Path | None = None
    inputs: str = ""

    def of(self, arrays: Iterable[NDArray[Any]], settings: str) -> "Steps":
        """Return the same for steps that compute from these arrays and settings."""
        if self.folder is None:
            return self
        digest = hashlib.sha256(f"{version('placefield')} {settings}".encode())
        for array in arrays:
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data)
        return replace(self, inputs=digest.hexdigest())

    def share(self, number: int | None, what: str) -> Share:
        """Return what receives the progress of one step."""
        return lambda share: self.progress(number, what, share)

    def finish(self, name: str, compute: Callable[[], Arrays]) -> Arrays:
        """Return the result of a step: the kept one, or else what ``compute`` returns.

        Args:
            name: of the step, as part of a file name.
            compute: carries the step out. Its arrays hold no objects.
        """
        if self.folder is None:
            return compute()
        file = self.folder / f"{name}.npz"
        if (kept := _kept(file, self.inputs)) is not None:
            log.info("%s: finished before", file)
            return kept
        result = compute()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with written_whole(file) as beside, beside.open("wb") as opened:
                np.savez(opened, *result, np.array(self.inputs))
        except OSError as error:
            log.warning("%s: not kept: %s", file, error.strerror or error)
        return result


ONE_BY_ONE = Steps()
"""One channel after the other, without reports; nothing is kept."""


def _kept(file: Path, inputs: str) -> Arrays | None:
    """Return the result in a file; None if there is none, or it is damaged or of other inputs."""
    try:
        with np.load(file, allow_pickle=False) as held:
            *result, made_of = (held[f"arr_{number}"] for number in range(len(held.files)))
            return tuple(result) if made_of.item() == inputs else None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
