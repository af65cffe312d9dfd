import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.config import Config
from placefield.errors import ConfigError
from placefield.loading import ENV_PREFIX
from placefield_tools.cli.options import effective_config
from placefield_tools.cli.options_map import min_scale_flags


@pytest.fixture(scope="module", autouse=True)
def _no_settings_from_outside() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith(ENV_PREFIX)]:
            patch.delenv(name)
        yield


def test_flags_win_over_set_over_the_file(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text("seed = 1\n[scales]\nchannels = 2\nmin_scale = 5\n")
    settings = ["scales.channels=3", "scales.min_scale=6"]
    config = effective_config(file, settings, scales__channels=7, scales__clusters=None)
    assert config.scales.channels == 7
    assert config.scales.min_scale == 6
    assert config.scales.clusters is None
    assert config.seed == 1


def test_without_anything_the_defaults_hold() -> None:
    assert effective_config(None, None) == Config()


def test_a_set_value_is_read_as_toml_and_a_bare_word_as_text() -> None:
    settings = ["features.standardise=false", "bus.connect_timeout_s = 0.5", "runs=night"]
    settings += ["matching.rule='ams'", "metric.kind=identity"]
    config = effective_config(None, settings)
    assert config.features.standardise is False
    assert config.bus.connect_timeout_s == 0.5
    assert (config.run, config.matching.rule) == ("night", "ams")
    assert config.metric.kind == "identity"


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("scales.chanels=3", "setting scales.chanels"),
        ("chanels=3", "setting chanels"),
        ("scales.channels=many", "setting scales.channels"),
        ("scales.channels=", "setting scales.channels"),
        ("scales=3", "setting scales"),
        ("scales.channels.more=3", "setting scales.channels"),
        ("scales.channels", "--set 'scales.channels': write it as KEY=VALUE"),
        ("", "--set '': write it as KEY=VALUE"),
        ("runs='no good name'", "setting runs"),
    ],
)
def test_a_setting_that_is_unknown_or_malformed_is_named(setting: str, named: str) -> None:
    with pytest.raises(ConfigError) as refused:
        effective_config(None, [setting])
    assert named in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_section_that_was_set_as_a_whole_takes_no_keys() -> None:
    with pytest.raises(ConfigError, match="--set scales: is a section"):
        effective_config(None, ["scales=3", "scales.channels=4"])
    with pytest.raises(ConfigError, match="--set bus: is a section"):
        effective_config(None, ["bus=3"], bus__endpoint="tcp/127.0.0.1:1")


@given(st.lists(st.text(max_size=12) | st.from_regex(r"[a-z_.]+=.*", fullmatch=True), max_size=4))
def test_whatever_is_set_a_configuration_or_a_config_error_comes_out(settings: list[str]) -> None:
    with suppress(ConfigError):
        effective_config(None, settings)


def test_the_smallest_scale_is_in_frames_or_in_metres() -> None:
    assert min_scale_flags(None) == {}
    assert min_scale_flags("6") == {"scales__min_scale": 6, "scales__min_scale_metres": 0}
    for metres in ("2.5m", "2.5 m"):
        assert min_scale_flags(metres) == {"scales__min_scale_metres": 2.5}


@pytest.mark.parametrize("text", ["", "m", "-3", "2.5", "4 frames", "2.5km", "²", ".5m"])
def test_a_smallest_scale_of_another_form_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"write frames as 4, or metres as 2\.5m"):
        min_scale_flags(text)


@pytest.mark.parametrize("value", ["[" * 3000 + "]" * 3000, "9" * 5000])
def test_a_setting_that_nobody_can_read_is_named(value: str) -> None:
    with pytest.raises(ConfigError, match=r"^--set seed: a number too long, or nested too deeply$"):
        effective_config(None, [f"seed={value}"])
