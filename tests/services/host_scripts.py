"""Small scripts that stand for the services of a host."""

from collections.abc import Sequence

from placefield_services.forkserver import Program


def _run(command: Sequence[str]) -> None:
    (script,) = command
    exec(script, {})


SCRIPTS = Program(_run, preload=["pytest"])  # the main module of tests, which each process imports
"""Runs command lines that are one script in Python."""
