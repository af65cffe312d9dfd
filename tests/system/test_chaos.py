"""``placefield chaos``, shortly; the faults that it makes each have a test of their own."""

import json
from pathlib import Path

from hosting import placefield


def test_chaos_tells_what_became_of_every_frame_and_fault(map_path: Path, query_dir: Path) -> None:
    flags = ("--faults", "2", "--rate", "30", "--seed", "22", "--json")
    ended = placefield("chaos", map_path, query_dir, *flags)
    assert ended.returncode == 0, ended.stderr
    verdict = json.loads(ended.stdout)
    faults = verdict.pop("faults")
    assert [fault["kind"] for fault in faults] == ["kill featurizer", "repeat"]
    recover_s = verdict.pop("recover_s")
    assert recover_s == max(fault["recover_s"] for fault in faults) > 0
    assert verdict == {"seed": 22, "sent": 180, "answered": 180, "partial": 0, "wrong": 0}
