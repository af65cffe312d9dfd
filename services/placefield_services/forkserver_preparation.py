"""Prepares the forkserver, which imports this module before all others.

A session of its own keeps Ctrl-C away from the forkserver and the services. The environment must be
right before numpy is imported, which reads the number of threads there.
"""

import gc
import os
import sys

from setproctitle import setproctitle

from placefield_services.child_environment import child_environment


def _prepare() -> None:
    os.setsid()
    setproctitle("placefield forkserver")  # before the environment changes, which lies beside it
    environment = child_environment()
    os.environ.clear()
    os.environ.update(environment)
    gc.disable()  # until the services serve


if "multiprocessing.forkserver" in sys.orig_argv[-1]:  # not where a test imports all modules
    _prepare()
