"""The commands that the page tells a person to run."""

import shlex
from dataclasses import dataclass
from pathlib import Path

from placefield.config import Config


@dataclass(frozen=True)
class Commands:
    """Commands for a run, to be copied into a terminal; they name what is not the default.

    Attributes:
        run: name of the run.
        map_path: the map of the page.
        endpoint: of the run's bus.
    """

    run: str
    map_path: Path
    endpoint: str

    @property
    def replay(self) -> str:
        """Replays a source."""
        return self._of("replay", "SOURCE")

    @property
    def up(self) -> str:
        """Starts the services with the map of the page."""
        return self._of("up", str(self.map_path))

    @property
    def dashboard(self) -> str:
        """Starts the page with another map."""
        return self._of("dashboard", "MAP")

    @property
    def inspect(self) -> str:
        """Prints the facts of a map, with its digest."""
        return "placefield inspect MAP"

    def _of(self, *command: str) -> str:
        usual, flags = Config(), []
        if self.run != usual.run:
            flags += ["--run", self.run]
        if self.endpoint != usual.bus.endpoint:
            flags += ["--endpoint", self.endpoint]
        return shlex.join(["placefield", *command, *flags])
