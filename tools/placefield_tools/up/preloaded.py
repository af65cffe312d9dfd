"""The modules of the services, for the forkserver to import."""
# ruff: noqa: F401

import gc

import numpy as np

import placefield_services.channel
import placefield_services.exploring_channel
import placefield_services.exploring_services
import placefield_services.featurizer
import placefield_services.fuser
import placefield_services.mapper
import placefield_services.mapserver
import placefield_services.verifier
import placefield_tools.cli.main
from placefield.kernels import sum_of

sum_of(np.zeros(1))  # loads the compiler
gc.freeze()  # so that no collection writes to the memory that the services share
