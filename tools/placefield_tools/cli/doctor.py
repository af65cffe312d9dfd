"""``placefield doctor``: checks whether this machine can run Placefield."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from placefield_tools.cli import options

if TYPE_CHECKING:
    from placefield_tools.doctor.finding import Finding

_COLOURS = {"good": "green", "warning": "yellow", "bad": "red"}


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("doctor")(_doctor)


def _doctor(
    camera: Annotated[
        str | None,
        typer.Option(metavar="SOURCE", help="a camera to read a frame from, for example camera:0"),
    ] = None,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    as_json: options.Json = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Check this machine: versions, what runs networks, cores, memory, the router, the camera.

    Each problem comes with advice. The exit code is 1 if something is bad.

    Examples:
      placefield doctor
      placefield doctor --camera rtsp://192.168.1.20/stream
    """
    from placefield_tools.doctor.camera_check import cameras
    from placefield_tools.doctor.installation import installation, of_networks
    from placefield_tools.doctor.machine import machine
    from placefield_tools.doctor.network_check import network

    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    findings = [
        *installation(),
        of_networks(effective.inference.provider),
        *machine(),
        *network(effective.bus, effective.runs),
        *cameras(camera),
    ]
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings]))
    else:
        _print(findings)
    if any(finding.verdict == "bad" for finding in findings):
        sys.exit(1)


def _print(findings: "Sequence[Finding]") -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    for finding in findings:
        said = Text(finding.found)
        if finding.advice:
            said.append(f"\n→ {finding.advice}", style="italic")
        verdict = Text(finding.verdict, style=_COLOURS[finding.verdict])
        table.add_row(finding.subject, verdict, said)
    Console(markup=False).print(table)
