from pathlib import Path

import pytest

from placefield.errors import SourceError
from placefield_tools.sources import NO_PARTS, Parts, open_source

ABSENT_CAMERA = 97


@pytest.mark.parametrize("where", ["nowhere", "nowhere/video.mp4", "camera:front", "x" * 5000])
def test_what_is_not_there_is_refused(where):
    with pytest.raises(SourceError, match=where[:40]) as refused:
        open_source(where)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("form", ["camera:{}", "/dev/video{}"])
def test_a_camera_that_is_absent_is_refused_quietly(capfd, form):
    if Path(f"/dev/video{ABSENT_CAMERA}").exists():
        pytest.skip(f"this machine has a camera {ABSENT_CAMERA}")
    with pytest.raises(SourceError, match=f"camera:{ABSENT_CAMERA}: cannot be opened"):
        open_source(form.format(ABSENT_CAMERA))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("path", ["s", "s.png", "s" * 5000])
def test_no_password_of_a_url_is_reported(path):
    for where in (f"rtps://me:secret@host/{path}", f"rtsp://me:secret@host/{path}"):
        with pytest.raises(SourceError) as refused:
            open_source(where, parts=Parts(topic="/a") if where.startswith("rtsp") else NO_PARTS)
        assert "host" in str(refused.value)
        assert "secret" not in str(refused.value)


def test_one_image_is_no_source(tmp_path):
    (tmp_path / "a.jpg").touch()
    with pytest.raises(SourceError, match=r"a\.jpg: .* the folder"):
        open_source(str(tmp_path / "a.jpg"))


@pytest.mark.parametrize("stride", [0, -1])
def test_a_stride_below_one_is_refused(tmp_path, stride):
    with pytest.raises(SourceError, match=f"--stride {stride}"):
        open_source(str(tmp_path), parts=Parts(stride=stride))


def test_a_negative_start_is_refused(tmp_path):
    with pytest.raises(SourceError, match="--start -1"):
        open_source(str(tmp_path), parts=Parts(start=-1))


@pytest.mark.parametrize(("start", "stop"), [(0, 0), (3, 3), (3, 2), (0, -1)])
def test_a_stop_that_is_not_behind_the_start_is_refused(tmp_path, start, stop):
    with pytest.raises(SourceError, match=f"--stop {stop}"):
        open_source(str(tmp_path), parts=Parts(start=start, stop=stop))


@pytest.mark.parametrize("spacing", [0, -1, float("nan"), float("inf")])
def test_a_spacing_that_is_no_distance_is_refused(tmp_path, spacing):
    with pytest.raises(SourceError, match=f"--spacing {spacing}"):
        open_source(str(tmp_path), spacing_m=spacing)
