"""The command ``placefield``."""

import sys

import numpy as np  # noqa: F401 - its BLAS must be there to be limited
import typer
from threadpoolctl import threadpool_limits

from placefield.errors import PlacefieldError
from placefield_tools.cli import (
    alive,
    bench,
    build,
    chaos,
    config,
    demo,
    doctor,
    evaluate,
    export,
    fetch,
    inspect,
    listen,
    plan,
    record,
    replay,
    ros,
    router,
    security,
    serve,
    services,
    status,
    study,
    up,
)
from placefield_tools.logs import log, log_for_a_person

app = typer.Typer(
    help="Visual place recognition with adaptive multiple scales, as a stream of processes.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_streaming = (plan, up, services, router, serve, fetch, replay, ros, listen, record, status, alive)
for module in (
    build,
    inspect,
    *_streaming,
    export,
    evaluate,
    study,
    bench,
    chaos,
    config,
    security,
    doctor,
    demo,
):
    module.add_to(app)


def main() -> None:
    """Run a command; a known error, or one of the disk, is one line on stderr and exit code 1.

    One BLAS thread: how many there are changes the last bits of products, and with them the map.
    """
    log_for_a_person()
    try:
        with threadpool_limits(1):
            app()
    except (PlacefieldError, OSError) as error:
        log.error("%s", error)
        sys.exit(1)


if __name__ == "__main__":
    main()
