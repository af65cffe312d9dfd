from pathlib import Path
from shutil import copytree

from placefield_tools.sources import open_source
from placefield_tools.sources.thinned import Thinned


def test_every_nth_frame_is_there_each_time(query_dir: Path) -> None:
    with open_source(str(query_dir)) as source:
        thinned = Thinned(source, 7, 60)
        for _ in range(2):
            assert [frame.index for frame in thinned] == [0, 7, 14, 21, 28, 35, 42, 49, 56]
    assert thinned.count == 9
    assert thinned.unthinned_count == 60


def test_of_a_spaced_source_the_spaced_frames_count(query_dir: Path, tmp_path: Path) -> None:
    files = sorted(copytree(query_dir, tmp_path / "spaced").iterdir())
    rows = [f"{file.name},{number // 3}" for number, file in enumerate(files)]  # 3 at each metre
    (tmp_path / "spaced" / "frames.csv").write_text("\n".join(["file,odometry", *rows]))
    with open_source(str(tmp_path / "spaced"), spacing_m=1) as spaced:
        thinned = [frame.odometry_m for frame in Thinned(spaced, 2, 20)]
    assert thinned == list(range(0, 20, 2))
