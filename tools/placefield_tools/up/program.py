"""What the child processes of a host run: a command of ``placefield``."""

from collections.abc import Sequence

from placefield_services.forkserver import Program
from placefield_tools.cli.main import main
from placefield_tools.common.own_command import PLACEFIELD


def _run(command: Sequence[str]) -> None:
    main(command[len(PLACEFIELD) :])


PROGRAM = Program(_run, preload=("placefield_tools.up.preloaded",))
