"""The command line, as ``placefield`` or ``python -m placefield_tools``."""

import signal


def main() -> None:
    """Run it. Ctrl-C ends it silently until there is a command to undo what was begun."""
    waits = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not in the background
    if waits:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from placefield_tools.cli.main import main as run

    if waits:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":
    main()
