import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import ConfigError
from placefield.loading import ENV_PREFIX, load_config


@pytest.fixture(scope="module", autouse=True)
def _no_settings_from_outside() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith(ENV_PREFIX)]:
            patch.delenv(name)
        yield


def refusal(file: Path | None = None, flags: dict[str, Any] | None = None) -> str:
    with pytest.raises(ConfigError) as refused:
        load_config(file, flags)
    message = str(refused.value)
    assert "\n" not in message
    return message


def test_flags_win_over_the_environment_over_the_file_over_the_defaults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "run.toml"
    file.write_text("seed = 1\n[scales]\nchannels = 2\nclusters = 20\nmin_scale = 5\n")
    monkeypatch.setenv("PLACEFIELD_SCALES__CHANNELS", "3")
    monkeypatch.setenv("PLACEFIELD_SCALES__CLUSTERS", "30")
    config = load_config(file, {"scales": {"channels": 4}})
    assert config.scales.channels == 4
    assert config.scales.clusters == 30
    assert config.scales.min_scale == 5
    assert config.scales.position_weight == Config().scales.position_weight
    assert config.seed == 1


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[scales]\nchanels = 3\n", "scales.chanels"),
        ("[scale]\nchannels = 3\n", "scale"),
        ("sead = 3\n", "sead"),
        ("[scales]\nchannels = 'many'\n", "scales.channels"),
        ("[scales]\nchannels = 0\n", "scales.channels"),
        ("scales = 3\n", "scales"),
        ("[matching]\nrule = 'nearest'\n", "matching.rule"),
        ("runs = ['one', 'two words']\n", "runs.1"),
        ("runs = 'one,'\n", "runs.1"),
        ("runs = ['one', 'one']\n", "runs"),
        ("runs = []\n", "runs"),
        ("[features]\nkind = 'surf'\n", "features.kind"),
        ("[features]\nkind = 'onnx:'\n", "features.kind"),
    ],
)
def test_an_unknown_key_or_a_malformed_value_is_named(tmp_path: Path, text: str, key: str) -> None:
    file = tmp_path / "run.toml"
    file.write_text(text)
    assert f"setting {key}:" in refusal(file)


def test_unknown_keys_and_malformed_values_are_named_wherever_they_come_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert "setting scales.chanels:" in refusal(flags={"scales": {"chanels": 3}})
    assert "setting seed:" in refusal(flags={"seed": -1})
    with monkeypatch.context() as patch:
        patch.setenv("PLACEFIELD_SCALES__CHANELS", "3")
        assert "setting scales.chanels:" in refusal()
    with monkeypatch.context() as patch:
        patch.setenv("PLACEFIELD_FEATURES__DIMENSIONS", "many")
        assert "setting features.dimensions:" in refusal()


def test_a_misspelt_section_in_the_environment_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLACEFIELD_SCALE__CHANNELS", "3")
    with pytest.raises(ConfigError, match="PLACEFIELD_SCALE__CHANNELS: no such section"):
        load_config()


def test_a_section_as_one_environment_variable_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLACEFIELD_SCALES", "channels=3")
    message = refusal()
    assert '"scales"' in message
    assert "PLACEFIELD_SCALES__CHANNELS" in message


@pytest.mark.parametrize("data", [b"[scales\n", b"seed = \xff\n", b"\x00"])
def test_a_file_that_is_no_toml_is_named(tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "run.toml"
    file.write_bytes(data)
    assert f"{file}: not valid TOML" in refusal(file)


def test_a_missing_or_unreadable_file_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.toml", tmp_path):
        assert f"{path}: no such" in refusal(path)
    unreadable = Path("/proc/self/mem")  # an error on reading, for root too
    if unreadable.is_file():
        assert f"{unreadable}: cannot be read" in refusal(unreadable)


def test_toml_shows_every_setting_that_has_a_value() -> None:
    shown = tomllib.loads(Config().to_toml())
    assert shown["runs"] == ["default"]
    assert shown["scales"] == {
        "channels": 4,
        "position_weight": 1.0,
        "fuzzifiers": [1.02, 1.4],
        "same_start": False,
        "min_scale": 4,
        "min_scale_metres": 0.0,
    }


positive = st.floats(1e-6, 1e6)
configs = st.fixed_dictionaries(
    {
        "runs": st.lists(
            st.from_regex(r"[A-Za-z0-9_-]+", fullmatch=True), min_size=1, unique=True
        ).map(tuple),
        "seed": st.integers(0, 2**40),
        "bus": st.fixed_dictionaries({"endpoint": st.text(), "connect_timeout_s": positive}),
        "features": st.fixed_dictionaries(
            {
                "kind": st.sampled_from(["gist", "grayscale", "onnx:a folder/net.onnx"]),
                "dimensions": st.none() | st.integers(1, 999),
                "standardise": st.booleans(),
            }
        ),
        "scales": st.fixed_dictionaries(
            {
                "clusters": st.none() | st.integers(2, 99),
                "min_scale_metres": st.just(0.0) | positive,
                "position_weight": st.just(0) | positive,
            }
        ),
        "matching": st.fixed_dictionaries({"rule": st.sampled_from(get_args(Rule))}),
    }
).map(Config.model_validate)


@settings(max_examples=25)
@given(configs)
def test_toml_comes_back_as_the_same_configuration(
    tmp_path_factory: pytest.TempPathFactory, config: Config
) -> None:
    file = tmp_path_factory.getbasetemp() / "round-trip.toml"
    file.write_text(config.to_toml(), encoding="utf-8")
    assert load_config(file) == config


@pytest.mark.parametrize("given_as", ["flag", "flags", "file", "environment"])
def test_several_runs_are_given_as_a_list_or_with_commas(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given_as: str
) -> None:
    file = tmp_path / "run.toml"
    file.write_text("runs = ['day', 'night']\n" if given_as == "file" else "")
    if given_as == "environment":
        monkeypatch.setenv("PLACEFIELD_RUNS", "day,night")
    flags = {"flag": {"runs": "day,night"}, "flags": {"runs": ["day", "night"]}}
    assert load_config(file, flags.get(given_as)).runs == ("day", "night")


def test_a_command_for_one_run_refuses_several() -> None:
    assert Config().run == "default"
    with pytest.raises(ConfigError, match="runs day, night: give one of them with --run"):
        _ = Config(runs=("day", "night")).run


def test_a_preset_replaces_the_defaults_and_given_settings_win(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text('preset = "paper"\n[metric]\npush = 0.25\n')
    config = load_config(file, {"scales": {"channels": 8}})
    assert config.preset == "paper"
    assert config.features.plain_pca
    assert not config.metric.gate
    assert config.metric.push == 0.25
    assert (config.scales.channels, config.scales.position_weight) == (8, 0.0)
    assert config.matching.rule == "ams"
    assert config.matching.tolerance == MatchingConfig().tolerance
    assert load_config(file, {"matching": {"rule": "evidence"}}).matching.rule == "evidence"


@pytest.mark.parametrize("from_environment", [True, False])
def test_a_preset_is_known_by_its_name_wherever_it_is_given(
    from_environment: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if from_environment:
        monkeypatch.setenv("PLACEFIELD_PRESET", "paper")
    assert load_config(None, {} if from_environment else {"preset": "paper"}).features.plain_pca
    with pytest.raises(ConfigError, match=r"setting preset: .*'paper'.*given: 'papers'"):
        load_config(None, {"preset": "papers"})


def test_the_configuration_of_a_preset_is_read_back_unchanged(tmp_path: Path) -> None:
    config = load_config(None, {"preset": "paper"})
    file = tmp_path / "settings.toml"
    file.write_text(config.to_toml())
    assert load_config(file) == config


@pytest.mark.parametrize("push", [-0.1, 1.1, "half", "nan"])
def test_push_is_a_share_or_is_to_be_chosen_by_cross_validation(push: object) -> None:
    with pytest.raises(ConfigError, match=r"metric\.push: give a fraction from 0 to 1, or cross"):
        load_config(None, {"metric": {"push": push}})
    assert load_config(None, {"metric": {"push": "0.25"}}).metric.push == 0.25
    chosen = load_config(None, {"metric": {"push": "cross-validation"}})
    assert chosen.metric.push == "cross-validation"
    with pytest.raises(ConfigError, match="has not been done"):
        print(chosen.metric.push_share)


@pytest.mark.parametrize("value", ["[" * 5000, "9" * 5000, '{"a":' * 5000])
def test_an_unreadable_value_is_one_short_line_wherever_it_is_given(
    value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "settings.toml"
    file.write_text(f"seed = {value}")
    lines = [refusal(file)]
    for name in ("SEED", "SCALES", "SCALES__FUZZIFIERS"):
        monkeypatch.setenv(ENV_PREFIX + name, value)
        lines.append(refusal())
        monkeypatch.delenv(ENV_PREFIX + name)
    for line in lines:
        assert "\n" not in line
        assert len(line) < 300
