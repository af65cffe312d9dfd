"""``placefield chaos``: a replay whose services are killed, stopped and sent bad messages."""

import json
import logging
from typing import TYPE_CHECKING, Annotated

import typer

from placefield_tools.cli import options, options_frames, options_map

if TYPE_CHECKING:
    from rich.table import Table

    from placefield_tools.chaos.verdict import Verdict


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("chaos")(_chaos)


def _chaos(
    map_path: options.MapPath,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="a folder of frames or a video; it repeats from its start"
        ),
    ],
    faults: Annotated[int, typer.Option(min=0, help="number of faults")] = 11,
    frames: Annotated[
        int | None,
        typer.Option(min=1, help="number of frames to replay", show_default="as the faults need"),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.01, help="frames per second")] = 12.0,
    seed: Annotated[int, typer.Option(min=0, help="seed of the schedule of faults")] = 0,
    camera: options_frames.Camera = None,
    as_json: options.Json = False,
    preset: options_map.PresetOption = None,
    rule: options_map.RuleOption = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Replay frames through its own services while it injects faults.

    It kills services and the router, up to three at once; it stops a channel worker for a while; it
    publishes garbage and old messages. Every frame must be answered, and every answer must be the
    same as offline or be flagged as partial. Otherwise the exit code is 1. One seed gives one
    schedule.

    Examples:
      placefield chaos route.pfmap dusk/ --seed 7
    """
    from rich.console import Console

    from placefield.errors import ConfigError
    from placefield.maps.manifest import read_manifest
    from placefield_tools.chaos.clock import RealClock
    from placefield_tools.chaos.disturbed_run import disturbed_replay
    from placefield_tools.chaos.schedule import APART, schedule
    from placefield_tools.common.parallel import cores
    from placefield_tools.sources import Parts, open_source
    from placefield_tools.sources.secrets import without_secrets
    from placefield_tools.up.service_commands import partition

    logging.getLogger("placefield").setLevel(
        logging.ERROR
    )  # warnings about dropped garbage are expected
    effective = options.effective_config(config, settings, preset=preset, matching__rule=rule)
    metrics = [channel.metric for channel in read_manifest(map_path).channels]
    count = frames or (faults + 1) * APART
    drawn = schedule(seed, count, faults)
    with open_source(source, parts=Parts(camera=camera)) as opened:
        if opened.live:
            shown = without_secrets(source)
            raise ConfigError(f"{shown}: a camera cannot be replayed; give a folder or a video")
        verdict = disturbed_replay(
            map_path,
            opened,
            drawn,
            effective,
            RealClock(),
            channels=partition(metrics, max(2, cores())),
            frames=count,
            rate=rate,
        )
    if as_json:
        print(json.dumps({"seed": seed} | verdict.as_json()))
    else:
        Console(markup=False).print(*_tables(verdict, seed))
    if not verdict.holds:
        raise typer.Exit(1)


def _tables(verdict: "Verdict", seed: int) -> "tuple[Table, Table]":
    from rich.table import Table

    faults = Table("frame", "fault", "recovered after", title=f"faults of seed {seed}")
    for each in verdict.recoveries:
        faults.add_row(str(each.fault.at), each.fault.kind, _seconds(each.seconds))
    counts = Table("sent", "answered", "partial", "wrong", "recovered", title="verdict")
    counted = (verdict.sent, verdict.answered, verdict.partial, verdict.wrong)
    counts.add_row(*map(str, counted), f"within {_seconds(verdict.recover_s)}")
    return faults, counts


def _seconds(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds:.2f} s"
