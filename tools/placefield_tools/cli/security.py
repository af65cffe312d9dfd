"""``placefield security``: credentials, for a bus exposed to untrusted clients."""

from pathlib import Path
from typing import Annotated

import typer


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    security = typer.Typer(
        help="Credentials, for a bus exposed to untrusted clients.", no_args_is_help=True
    )
    security.command("init")(_init)
    app.add_typer(security, name="security")


def _init(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="a new or empty folder", show_default=False),
    ],
    host: Annotated[
        list[str] | None,
        typer.Option(help="name or address of a router's host; may be repeated"),
    ] = None,
    days: Annotated[
        int, typer.Option(min=1, max=3650, help="days that the credentials are valid")
    ] = 825,
) -> None:
    """Make a certificate authority, a certificate for each role, and the rights of each role.

    Each role is a folder. Copy it to the role's hosts, and give it as --credentials FOLDER, with
    --endpoint tls/HOST:PORT. Keep ca-key.pem in a safe place: its owner can make credentials.

    Examples:
      placefield security init pki --host robot.example
    """
    from placefield_tools.security.folders import write_credentials

    roles = write_credentials(folder, host or [], days)
    print(f"{folder}: credentials of {', '.join(roles)}, valid for {days} days")
