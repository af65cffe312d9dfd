"""Reads the configuration from defaults, a preset, TOML, environment and flags."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_settings import (
    BaseSettings,
    InitSettingsSource,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    SettingsError,
)

from placefield.config import Config
from placefield.errors import ConfigError
from placefield.features.kinds import FEATURES, ONNX, kinds_of
from placefield.plugins import has_plugin
from placefield.presets import PRESETS
from placefield.toml import parse_toml

ENV_PREFIX = "PLACEFIELD_"

_SHOWN = 60  # most characters of a refused value in an error


def _check_sections(environment: Iterable[str]) -> None:
    """Refuse a misspelt section, which pydantic-settings would ignore."""
    for name in environment:
        section, nested, _ = name.lower().removeprefix(ENV_PREFIX.lower()).partition("__")
        is_ours = nested and name.lower().startswith(ENV_PREFIX.lower())
        if is_ours and section not in Config.model_fields:
            raise ConfigError(f"environment: {name}: no such section; see 'placefield config'")


def load_config(file: Path | None = None, flags: Mapping[str, Any] | None = None) -> Config:
    """Read the configuration: flags over the environment over the file over the defaults.

    A preset, wherever it is named, replaces the defaults.

    Args:
        file: TOML, one table per section.
        flags: nested like the configuration, as ``{"scales": {"channels": 8}}``.

    The environment is read as ``PLACEFIELD_SCALES__CHANNELS=8``.

    Raises:
        ConfigError: a key is unknown, a value is malformed, or the file is missing, unreadable or
            not TOML.
    """
    of_file = {} if file is None else _read(file)
    _check_sections(os.environ)

    class Loader(Config, BaseSettings):
        model_config = SettingsConfigDict(env_prefix=ENV_PREFIX, env_nested_delimiter="__")

        @classmethod
        def settings_customise_sources(
            cls,
            settings_cls: type[BaseSettings],
            init_settings: PydanticBaseSettingsSource,
            env_settings: PydanticBaseSettingsSource,
            dotenv_settings: PydanticBaseSettingsSource,
            file_secret_settings: PydanticBaseSettingsSource,
        ) -> tuple[PydanticBaseSettingsSource, ...]:
            toml_settings = InitSettingsSource(settings_cls, init_kwargs=of_file)
            given = init_settings, env_settings, toml_settings
            named = next((name for source in given if (name := source().get("preset"))), None)
            # An unknown preset is refused by the validation below.
            preset = PRESETS[named] if isinstance(named, str) and named in PRESETS else {}
            return *given, InitSettingsSource(settings_cls, init_kwargs=dict(preset))

    try:
        config = Config.model_validate(Loader(**(flags or {})).model_dump())
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            raise ConfigError(f"setting {key}: there is none; see 'placefield config'") from None
        given = repr(first["input"])
        given = given if len(given) <= _SHOWN else f"{given[:_SHOWN]}…"
        raise ConfigError(f"setting {key}: {first['msg']} (given: {given})") from None
    except SettingsError as error:
        raise ConfigError(
            f"environment: {error}; give one key a variable, as {ENV_PREFIX}SCALES__CHANNELS=8"
        ) from None
    except RecursionError:  # flags and file have been read
        raise ConfigError(f"environment: a {ENV_PREFIX} variable is nested too deeply") from None
    _check_feature(config.features.kind)
    return config


def _check_feature(kind: str) -> None:
    for part in kinds_of(kind):
        if part in FEATURES or part.startswith(ONNX) or has_plugin("placefield.features", part):
            continue
        raise ConfigError(
            f"setting features.kind: {part!r}: give {', '.join(FEATURES)} or {ONNX}FILE, or "
            "install the package that brings it"
        )


def _read(file: Path) -> dict[str, Any]:
    if not file.is_file():
        raise ConfigError(f"{file}: no such configuration file")
    try:
        return parse_toml(file.read_bytes(), str(file))
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from None
