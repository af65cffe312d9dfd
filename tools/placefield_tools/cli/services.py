"""``placefield featurizer``, ``channel``, ``fuser`` and the like: one service, on any host."""

import re
from collections.abc import Sequence
from typing import Annotated

import typer

from placefield.config import FusionConfig
from placefield.errors import ConfigError
from placefield_tools.cli import options, options_map


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("featurizer")(_featurizer)
    app.command("describer")(_describer)
    app.command("channel")(_channel)
    app.command("fuser")(_fuser)
    app.command("verifier")(_verifier)


def _featurizer(
    map_path: options.MapPath,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    metrics_port: options.MetricsPort = None,
    lineage: options.Lineage = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as featurizer: frames in, descriptors out.

    Examples:
      placefield featurizer route.pfmap --run front --run rear
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield.maps.opening import open_map
    from placefield_services.featurizer import run_featurizer

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
    )
    placemap = open_map(map_path, channels=(), lineage=lineage)
    run_featurizer(placemap, effective, stop_of_service())
    leave()


def _describer(
    map_path: options.MapPath,
    part: Annotated[
        str | None,
        typer.Option(
            help="describe only this part of the feature, as gist or mobilenetv2 of "
            "gist+mobilenetv2; then it falls to the describers with this flag alone",
            show_default=False,
        ),
    ] = None,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    metrics_port: options.MetricsPort = None,
    lineage: options.Lineage = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as describer: compute the features of a share of the frames for the featurizer.

    Describers are optional. Start as many as the feature needs, on any host: they describe the
    frames in turn, and the parts of a feature such as gist+mobilenetv2 at the same time. The
    matches are the same.

    Examples:
      placefield describer route.pfmap
      placefield describer route.pfmap --part mobilenetv2 --set inference.provider=cuda
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield.features.joined_model import part_names
    from placefield.maps.opening import open_map
    from placefield_services.describer import run_describer

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
    )
    placemap = open_map(map_path, channels=(), lineage=lineage)
    number = None if part is None else _part(part, part_names(placemap.model))
    run_describer(placemap, effective, stop_of_service(), part=number)
    leave()


def _part(name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise ConfigError(f"--part {name}: the map has no such feature; give {' or '.join(names)}")
    return names.index(name)


def _channel(
    map_path: options.MapPath,
    channel: Annotated[
        list[int], typer.Option(min=0, help="number of a channel of the map; may be repeated")
    ],
    shard: Annotated[
        str,
        typer.Option(help="part of the places, for example 0/4 to 3/4 for four workers"),
    ] = "0/1",
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    preset: options_map.PresetOption = None,
    rule: options_map.RuleOption = None,
    exact: options_map.Exact = None,
    metrics_port: options.MetricsPort = None,
    lineage: options.Lineage = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as channel worker: descriptors in, a candidate per channel out.

    Examples:
      placefield channel route.pfmap --channel 0 --channel 1
      placefield channel route.pfmap --channel 0 --shard 0/4
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield_services.channel import run_channels
    from placefield_services.map_versions import MapVersions

    effective = options.effective_config(
        config,
        settings,
        preset=preset,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
        matching__rule=rule,
        matching__exact=exact,
    )
    number, shards = _shard(shard)
    versions = MapVersions(map_path, channel, lineage)
    run_channels(versions, channel, effective, stop_of_service(), shard=number, shards=shards)
    leave()


def _shard(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([0-9]{1,5})/([0-9]{1,5})", text)
    number, shards = map(int, found.groups()) if found else (1, 0)
    if number >= shards:
        raise ConfigError(f"--shard {text!r}: write it as 0/4, from 0/4 to 3/4 for four of them")
    return number, shards


def _fuser(
    map_path: options.MapPath,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    preset: options_map.PresetOption = None,
    rule: options_map.RuleOption = None,
    precision: options_map.Precision = None,
    deadline: Annotated[
        float | None,
        typer.Option(
            help="seconds to wait for the candidates of a frame",
            show_default=f"{FusionConfig().deadline_s:g}",
        ),
    ] = None,
    metrics_port: options.MetricsPort = None,
    lineage: options.Lineage = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as fuser: candidates in, one match per frame out.

    Examples:
      placefield fuser route.pfmap --precision 0.999
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield_services.fuser import run_fuser
    from placefield_services.map_versions import MapVersions

    effective = options.effective_config(
        config,
        settings,
        preset=preset,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
        matching__rule=rule,
        matching__precision=precision,
        fusion__deadline_s=deadline,
    )
    run_fuser(MapVersions(map_path, lineage=lineage), effective, stop_of_service())
    leave()


def _verifier(
    map_path: options.MapPath,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    precision: options_map.Precision = None,
    metrics_port: options.MetricsPort = None,
    lineage: options.Lineage = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as verifier: frames and smoothed matches in, verified matches out.

    The map must have local features: build it with --set build.local_features=600. Start as many
    verifiers as you like; they share the matches. With --set verification.focal=F a verified match
    has the relative pose of its frame.

    Examples:
      placefield verifier route.pfmap
      placefield verifier route.pfmap --set verification.focal=0.9
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield_services.map_versions import MapVersions
    from placefield_services.verifier import run_verifier

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
        matching__precision=precision,
    )
    run_verifier(MapVersions(map_path, lineage=lineage), effective, stop_of_service())
    leave()
