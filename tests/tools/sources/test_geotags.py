from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from PIL.ExifTags import GPS, IFD, Base

from placefield.maps.geography import Origin
from placefield_tools.sources import open_source
from placefield_tools.sources.geotags import Geotag, read_geotag

OXFORD = (51.7602, -1.2588)


def sexagesimal(degrees: float) -> tuple[float, float, float]:
    minutes = abs(degrees) % 1 * 60
    return float(int(abs(degrees))), float(int(minutes)), minutes % 1 * 60


def photograph(
    path: Path, degrees: tuple[float, float] | None = None, when: dict[Base, str] | None = None
) -> Path:
    exif = Image.Exif()
    exif[Base.Make] = "a camera"  # without one of these Pillow writes no tags into a PNG
    if degrees is not None:
        latitude, longitude = degrees
        exif.get_ifd(IFD.GPSInfo).update(
            {
                GPS.GPSLatitudeRef: "N" if latitude >= 0 else "S",
                GPS.GPSLatitude: sexagesimal(latitude),
                GPS.GPSLongitudeRef: "E" if longitude >= 0 else "W",
                GPS.GPSLongitude: sexagesimal(longitude),
            }
        )
    exif.get_ifd(IFD.Exif).update(when or {})
    Image.new("L", (16, 16)).save(path, exif=exif)
    return path


@pytest.mark.parametrize("degrees", [OXFORD, (-27.5, 153.0), (0.0, -0.001)])
def test_the_position_is_read_whichever_side_it_is_on(
    tmp_path: Path, degrees: tuple[float, float]
) -> None:
    tag = read_geotag(photograph(tmp_path / "a.jpg", degrees))
    assert tag.degrees == pytest.approx(degrees, abs=1e-7)


def test_no_fix_is_no_position(tmp_path: Path) -> None:
    assert read_geotag(photograph(tmp_path / "a.jpg", (0.0, 0.0))).degrees is None
    void = Image.open(photograph(tmp_path / "b.jpg", OXFORD))
    exif = void.getexif()
    exif.get_ifd(IFD.GPSInfo)[GPS.GPSStatus] = "V"
    void.save(tmp_path / "c.jpg", exif=exif)
    assert read_geotag(tmp_path / "c.jpg").degrees is None
    exif.get_ifd(IFD.GPSInfo)[GPS.GPSStatus] = "A"
    void.save(tmp_path / "d.jpg", exif=exif)
    assert read_geotag(tmp_path / "d.jpg").degrees == pytest.approx(OXFORD)


@pytest.mark.parametrize("side", ["", "EW", "east"])
def test_a_position_on_no_side_is_none(tmp_path: Path, side: str) -> None:
    exif = Image.Exif()
    exif.get_ifd(IFD.GPSInfo).update(
        {
            GPS.GPSLatitudeRef: "N",
            GPS.GPSLatitude: (51.0, 0.0, 0.0),
            GPS.GPSLongitudeRef: side,
            GPS.GPSLongitude: (1.0, 0.0, 0.0),
        }
    )
    Image.new("L", (16, 16)).save(tmp_path / "a.jpg", exif=exif)
    assert read_geotag(tmp_path / "a.jpg").degrees is None


@pytest.mark.parametrize(
    ("tags", "when"),
    [
        ({}, datetime(2024, 2, 29, 23, 59, 58, tzinfo=UTC)),
        ({Base.OffsetTimeOriginal: "   :  "}, datetime(2024, 2, 29, 23, 59, 58, tzinfo=UTC)),
        ({Base.OffsetTimeOriginal: ""}, datetime(2024, 2, 29, 23, 59, 58, tzinfo=UTC)),
        ({Base.OffsetTimeOriginal: "+10:00"}, datetime(2024, 2, 29, 13, 59, 58, tzinfo=UTC)),
        (
            {Base.SubsecTimeOriginal: "25"},
            datetime(2024, 2, 29, 23, 59, 58, 250_000, tzinfo=UTC),
        ),
    ],
)
def test_the_time_is_read_with_its_fraction_and_offset(
    tmp_path: Path, tags: dict[Base, str], when: datetime
) -> None:
    tags = {Base.DateTimeOriginal: "2024:02:29 23:59:58"} | tags
    tag = read_geotag(photograph(tmp_path / "a.jpg", when=tags))
    assert tag.stamp_ns == round(when.timestamp() * 1000) * 1_000_000


@pytest.mark.parametrize(
    "when", ["", "0000:00:00 00:00:00", "yesterday", "2024:13:01 00:00:00", "1969:12:31 00:00:00"]
)
def test_a_time_that_is_none_is_none(tmp_path: Path, when: str) -> None:
    tags = {Base.DateTimeOriginal: when}
    assert read_geotag(photograph(tmp_path / "a.jpg", when=tags)) == Geotag()


@given(st.data())
def test_a_damaged_photograph_has_tags_or_none_and_does_no_harm(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = photograph(tmp_path_factory.getbasetemp() / "damaged.jpg", OXFORD)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, 250))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    degrees = read_geotag(path).degrees
    assert degrees is None or (abs(degrees[0]) <= 90 and abs(degrees[1]) <= 180)


def test_a_folder_of_photographs_has_stamps_poses_and_an_origin(tmp_path: Path) -> None:
    latitude, longitude = OXFORD
    for at in range(3):
        when = {Base.DateTimeOriginal: f"2024:02:29 00:00:0{at}"}
        photograph(tmp_path / f"{at}.jpg", (latitude + at / 1e4, longitude), when)
    with open_source(str(tmp_path)) as source:
        frames = list(source)
        assert (source.origin.latitude, source.origin.longitude) == pytest.approx(OXFORD)
        assert Origin.of_frame(source.origin.frame) == source.origin
    assert np.diff([frame.stamp_ns for frame in frames]).tolist() == [10**9] * 2
    for at, frame in enumerate(frames):
        east, north, _ = pymap3d.geodetic2enu(latitude + at / 1e4, longitude, 0, *OXFORD, 0)
        assert (frame.pose.x, frame.pose.y) == pytest.approx((east, north), abs=0.01)
        assert frame.pose.yaw == pytest.approx(np.pi / 2, abs=1e-3)


def test_photographs_without_a_position_have_no_pose_and_keep_their_turn(tmp_path: Path) -> None:
    for at, degrees in enumerate([None, OXFORD, None, OXFORD]):
        photograph(tmp_path / f"{at}.jpg", degrees)
    Image.new("L", (16, 16)).save(tmp_path / "4.png")
    assert [frame.pose is None for frame in open_source(str(tmp_path))] == [1, 0, 1, 0, 1]


def timed(folder: Path, times: dict[str, str | None]) -> str:
    """Write photographs taken at seconds of one minute, as ``5`` or ``5.25``."""
    for name, second in times.items():
        when = {}
        if second is not None:
            whole, _, fraction = second.partition(".")
            when = {Base.DateTimeOriginal: f"2024:02:29 00:00:{int(whole):02}"}
            if fraction:
                when[Base.SubsecTimeOriginal] = fraction
        photograph(folder / name, when=when)
    return str(folder)


def order_of(where: str) -> list[str]:
    frames = list(open_source(where))
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(stamps)
    return [frame.name.partition("/")[2] for frame in frames]


@pytest.mark.parametrize("suffix", ["jpg", "jpeg", "JPG", "png", "webp"])
@given(seconds=st.lists(st.integers(0, 5999), min_size=2, max_size=7))
def test_the_times_are_the_order_and_equal_ones_leave_that_of_the_names(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, seconds: list[int]
) -> None:
    names = [f"IMG_{at}.{suffix}" for at in range(len(seconds))]
    times = {
        name: f"{each // 100}.{each % 100:02}" for name, each in zip(names, seconds, strict=True)
    }
    where = timed(tmp_path_factory.mktemp("timed"), dict(times))
    assert order_of(where) == sorted(names, key=lambda name: float(times[name]))


def test_where_names_and_times_differ_one_line_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    where = timed(tmp_path, {"1.jpg": "5", "2.jpg": "4", "10.jpg": "6"})
    assert order_of(where) == ["2.jpg", "1.jpg", "10.jpg"]
    [line] = caplog.messages
    assert "frame 0 is 2.jpg, not 1.jpg" in line
    assert "the times are used" in line


def test_where_they_agree_nothing_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    where = timed(tmp_path, {"1.jpg": "4", "2.jpg": "4", "10.jpg": "6"})
    assert order_of(where) == ["1.jpg", "2.jpg", "10.jpg"]
    assert not caplog.messages


def test_of_nearly_all_times_the_others_keep_their_turn(tmp_path: Path) -> None:
    times: dict[str, str | None] = {f"{at:02}.jpg": str(40 - at) for at in range(20)}
    times["07.jpg"] = None
    order = order_of(timed(tmp_path, times))
    assert [name for name in order if name != "07.jpg"] == [
        f"{at:02}.jpg" for at in reversed(range(20)) if at != 7
    ]
    assert order[order.index("07.jpg") - 1] == "06.jpg"


def test_of_a_few_times_the_names_are_the_order_and_this_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    where = timed(tmp_path, {"1.jpg": "5", "2.jpg": "4", "3.jpg": None, "4.jpg": None})
    assert [frame.stamp_ns for frame in open_source(where)] == [at * 10**8 for at in range(4)]
    assert order_of(where) == ["1.jpg", "2.jpg", "3.jpg", "4.jpg"]
    assert "2 of 4 photographs have a time" in caplog.text


def test_times_smooth_a_counter_that_wraps(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = [f"DSC_{number % 10_000:04}.jpg" for number in range(9990, 10_010)]
    assert order_of(timed(tmp_path, {n: str(at) for at, n in enumerate(names)})) == names
    assert "frame 0 is DSC_9990.jpg" in caplog.text
    assert "to wrap" not in caplog.text
