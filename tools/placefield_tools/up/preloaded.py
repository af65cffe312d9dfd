"""The modules of the services, for the forkserver to import."""

import gc

import numpy as np

import placefield_tools.cli.main  # noqa: F401
from placefield.kernels import sum_of

sum_of(np.zeros(1))  # loads the compiler
gc.freeze()  # so that no collection writes to the memory that the services share
