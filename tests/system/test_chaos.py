"""``placefield chaos``, shortly; the faults that it makes each have a test of their own."""

import json
from pathlib import Path

from hosting import placefield

from placefield_tools.chaos.schedule import schedule


def test_chaos_reports_what_became_of_every_frame_and_fault(
    map_path: Path, query_dir: Path
) -> None:
    flags = ("--faults", "2", "--rate", "30", "--seed", "22", "--json")
    ended = placefield("chaos", map_path, query_dir, *flags)
    assert ended.returncode == 0, ended.stderr
    verdict = json.loads(ended.stdout)
    faults = verdict.pop("faults")
    drawn = schedule(22, 180, 2)
    assert [(fault["kind"], fault["at"]) for fault in faults] == [(d.kind, d.at) for d in drawn]
    assert faults[0]["kind"] == "kill featurizer and fuser"
    assert faults[0]["at"] <= 10
    known = [fault["recover_s"] for fault in faults if fault["recover_s"] is not None]
    assert verdict.pop("recover_s") == max(known) > 0
    assert verdict.pop("partial") < 100
    assert verdict == {"seed": 22, "sent": 180, "answered": 180, "wrong": 0}
