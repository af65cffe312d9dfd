"""The command line of this program, for processes that it starts."""

import sys

PLACEFIELD = (sys.executable, "-m", "placefield_tools")
"""The beginning of a command line: the same interpreter and the same installation."""
