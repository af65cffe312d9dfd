"""Run the command line as ``python -m placefield_tools``."""

from placefield_tools.cli.main import main

main()
