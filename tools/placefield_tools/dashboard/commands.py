"""The commands that the page tells a person to run."""

import shlex
from dataclasses import dataclass
from pathlib import Path

from placefield.config import BusConfig


@dataclass(frozen=True)
class Commands:
    """Commands for a run, to be copied into a terminal.

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
        return f"placefield replay SOURCE {self._flags}"

    @property
    def up(self) -> str:
        """Starts the services with the map of the page."""
        return f"placefield up {shlex.quote(str(self.map_path))} {self._flags}"

    @property
    def dashboard(self) -> str:
        """Starts the page with another map."""
        return f"placefield dashboard MAP {self._flags}"

    @property
    def _flags(self) -> str:
        is_default = self.endpoint == BusConfig().endpoint
        return shlex.join(
            ["--run", self.run, *([] if is_default else ["--endpoint", self.endpoint])]
        )
