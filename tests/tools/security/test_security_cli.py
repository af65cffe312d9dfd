from pathlib import Path

import pytest

from placefield_tools.cli.main import main


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr("sys.argv", ["placefield", "security", "init", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_it_says_what_it_made_and_refuses_to_make_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "pki"
    assert run(monkeypatch, folder, "--host", "robot.example", "--host", "10.0.0.7") == 0
    made = capsys.readouterr().out
    assert made.startswith(f"{folder}: credentials of router, ")
    assert "valid for 825 days" in made
    assert run(monkeypatch, folder) == 1
    assert capsys.readouterr().err == (
        f"placefield: {folder}: there is something; credentials are written to a new folder\n"
    )


def test_a_folder_that_cannot_be_made_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert run(monkeypatch, tmp_path / "file" / "pki") == 1
    assert str(tmp_path / "file" / "pki") in capsys.readouterr().err
