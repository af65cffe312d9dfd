"""Prepares the forkserver, which imports this module before all others.

A session of its own keeps Ctrl-C away from the forkserver and the services. The environment must be
right before numpy is imported, which reads the number of threads there.
"""

import gc
import os

from setproctitle import setproctitle

from placefield_services.child_environment import child_environment

os.setsid()
setproctitle("placefield forkserver")  # before the environment changes, which is beside the title
_environment = child_environment()
os.environ.clear()
os.environ.update(_environment)
gc.disable()  # until the services work
