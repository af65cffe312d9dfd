import tomllib

import pytest

from placefield.errors import ConfigError
from placefield.toml import parse_toml

BAD = {
    "deep list": b"a = " + b"[" * 5000 + b"]" * 5000,
    "deep table": b"a = " + b"{a=" * 3000 + b"1" + b"}" * 3000,
    "many digits": b"seed = " + b"9" * 5000,
    "cut off": b"a = ",
    "no text": b"a = '\xff'",
    "a null": b"a = 1\0",
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_toml_is_one_short_line_that_names_it(name: str) -> None:
    with pytest.raises(ConfigError) as refused:
        parse_toml(BAD[name], "route.toml")
    line = str(refused.value)
    assert line.startswith("route.toml: not valid TOML: ")
    assert "\n" not in line
    assert len(line) < 200


def test_toml_is_read_as_the_standard_library_reads_it() -> None:
    written = "[scales]\nchannels = 8\nname = 'é'\n"
    assert parse_toml(written.encode(), "x") == tomllib.loads(written)
