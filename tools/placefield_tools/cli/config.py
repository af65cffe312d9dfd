"""``placefield config``: the settings in force."""

import typer

from placefield_tools.cli import options, options_map


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("config")(_config)


def _config(
    preset: options_map.PresetOption = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Print the settings in force, as TOML for --config.

    The order of precedence is: flags, the environment (PLACEFIELD_SCALES__CHANNELS=8), the file of
    --config, the preset, the defaults.

    Examples:
      placefield config > placefield.toml
      placefield config --preset paper --set scales.channels=8
    """
    print(options.effective_config(config, settings, preset=preset).to_toml(), end="")
