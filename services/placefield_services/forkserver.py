"""Child processes that are forked from one process, the forkserver.

To import the libraries takes most of the time of a service's start. The forkserver of
``multiprocessing`` imports them once. It never has a thread or a session on the bus, so a forked
process can begin both.
"""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path

from setproctitle import setproctitle, setthreadtitle

LOST = 255
"""Exit code that ``multiprocessing`` gives a process if the forkserver was killed."""

_PREPARATION = "placefield_services.forkserver_preparation"
_SIGNALS = {signal.SIGINT, signal.SIGTERM}


@dataclass(frozen=True)
class Program:
    """What child processes run.

    Attributes:
        run: runs a command line; a function of a module.
        preload: modules that the forkserver imports. It imports none on macOS, where the libraries
            of the system must not be loaded before a fork.
    """

    run: Callable[[Sequence[str]], object]
    preload: Sequence[str] = ()


def fork(program: Program, command: Sequence[str]) -> BaseProcess:
    """Start a process that runs a command line, and that has it as its title.

    The first call starts the forkserver, and waits until it has imported the modules. So does a
    call after the forkserver was killed.

    Raises:
        EOFError, ConnectionError: the forkserver was killed meanwhile.
    """
    context = get_context("forkserver")
    preload = [] if sys.platform == "darwin" else program.preload
    context.set_forkserver_preload([_PREPARATION, *preload])
    process = context.Process(target=_run, args=(program.run, command))
    resource_tracker.ensure_running()  # it unblocks signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        process.start()  # the forkserver never gets the signals, as it inherits the mask
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return process


def end_if_lost(process: BaseProcess) -> None:
    """Kill a process that has lived on after the forkserver was killed."""
    if process.exitcode == LOST and process.pid is not None:
        with suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)


def _run(run: Callable[[Sequence[str]], object], command: Sequence[str]) -> None:
    os.setsid()  # Linux shares the processors fairly among sessions
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    setproctitle(" ".join(command))
    setthreadtitle(Path(command[0]).name)  # the name of the process, which the title has changed
    try:
        run(command)
    except Exception:
        sys.excepthook(*sys.exc_info())  # as if it were the main program
        sys.exit(1)
