"""Options that all commands share, and how flags become a configuration."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from placefield.config import Config
from placefield.errors import ConfigError
from placefield.loading import load_config
from placefield_tools.common.log_format import log_as_json

_DEFAULTS = Config()


def _log_as_json(wanted: bool) -> bool:
    if wanted:
        log_as_json()
    return wanted


MapPath = Annotated[
    Path, typer.Argument(metavar="MAP", help="a map: NAME.pfmap", show_default=False)
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="a TOML file of settings; see 'placefield config'")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="any setting, for example scales.channels=8"),
]
Run = Annotated[
    str | None, typer.Option("--run", help="name of the run", show_default=_DEFAULTS.run)
]
Runs = Annotated[
    list[str] | None,
    typer.Option("--run", help="name of a run; may be repeated", show_default=_DEFAULTS.run),
]
Endpoint = Annotated[
    str | None,
    typer.Option(metavar="ENDPOINT", help="the router", show_default=_DEFAULTS.bus.endpoint),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(metavar="ENDPOINT", help="a router of another host; may be repeated"),
]
Credentials = Annotated[
    str | None,
    typer.Option(
        metavar="FOLDER",
        help="folder of this role's credentials; 'placefield security init' makes it",
        show_default=False,
    ),
]
MetricsPort = Annotated[
    int | None,
    typer.Option(
        "--metrics-port",
        metavar="PORT",
        help="port that Prometheus reads; --set monitoring.host=0.0.0.0 exposes it to the network",
        show_default="none",
    ),
]
Lineage = Annotated[
    str | None,
    typer.Option(
        metavar="DIGITS",
        help="refuse a map of another lineage, which is no version of the served one; 'up' sets it",
        show_default="any",
    ),
]
LogJson = Annotated[
    bool,
    typer.Option(
        "--log-json",
        help="log one JSON object per line",
        callback=_log_as_json,
        is_eager=True,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object")]
METRES = re.compile(r"(\d+(?:\.\d+)?)\s*m")


def effective_config(file: Path | None, settings: Sequence[str] | None, **flags: Any) -> Config:
    """Make the configuration of a command.

    Args:
        file: the file of ``--config``.
        settings: the values of ``--set``.
        flags: values of the command's own flags by key, ``scales__channels``. None and [] mean that
            the flag was not given.

    Raises:
        ConfigError: a file, a key or a value is not valid.
    """
    nested: dict[str, Any] = {}
    for key, value in [*map(_setting, settings or ()), *flags.items()]:
        if value is None or value == []:
            continue
        *sections, name = key.split("__")
        table = nested
        for section in sections:
            table = table.setdefault(section, {})
            if not isinstance(table, dict):
                raise ConfigError(f"--set {section}: is a section; set one of its keys")
        table[name] = value
    return load_config(file, nested)


def metres_of(flag: str, text: str) -> float:
    """Return the value of a flag in metres, from text like ``2.5m``.

    Raises:
        ConfigError: the text has another form, or the distance is 0.
    """
    metres = METRES.fullmatch(text)
    if metres is None or float(metres[1]) == 0:
        raise ConfigError(f"{flag} {text!r}: write metres as 2.5m")
    return float(metres[1])


def _setting(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or key.lstrip().startswith("_"):
        raise ConfigError(f"--set {text!r}: write it as KEY=VALUE")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value  # a bare word
    except (ValueError, RecursionError):
        raise ConfigError(f"--set {key}: a number too long, or nested too deeply") from None
    return key.strip().replace(".", "__"), parsed
