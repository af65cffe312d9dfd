"""``placefield security``: credentials, for a bus that strangers can reach."""

from pathlib import Path
from typing import Annotated

import typer


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    security = typer.Typer(
        help="Credentials, for a bus that strangers can reach.", no_args_is_help=True
    )
    security.command("init")(_init)
    app.add_typer(security, name="security")


def _init(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="to be made, or empty", show_default=False),
    ],
    host: Annotated[
        list[str] | None,
        typer.Option(help="name or address at which a router listens; may be repeated"),
    ] = None,
    days: Annotated[int, typer.Option(min=1, max=3650, help="how long they are valid")] = 825,
) -> None:
    """Make an authority, a certificate for each role, and what each role may do.

    Each role is a folder to be copied to its hosts and given as --credentials FOLDER, with
    --endpoint tls/HOST:PORT. Keep ca-key.pem where nobody reaches it: who has it is let in.

    Examples:
      placefield security init pki --host robot.example
    """
    from placefield_tools.security.folders import write_credentials

    roles = write_credentials(folder, host or [], days)
    print(f"{folder}: credentials of {', '.join(roles)}, valid for {days} days")
