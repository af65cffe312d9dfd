import contextlib
import os
import socket

import cv2
import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.errors import FrameError, SourceError
from placefield.features.frames import Pose
from placefield.features.images import decode
from placefield.maps.geography import Origin
from placefield_tools.sources import Parts, open_source
from placefield_tools.sources.frames_csv import COLUMNS, read_frames_csv

CELLS = st.sampled_from([*COLUMNS, "a.png", "0", "1", "-91", "1e99999", "nan", '"', "", " "])


def fill(folder, *names):
    """Write an image of one brightness per name, the name's position times ten."""
    for at, name in enumerate(names):
        (folder / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / name), np.full((16, 16), 10 * at, np.uint8))


def names(source):
    return [frame.name.partition("/")[2] for frame in source]


def test_frames_come_in_natural_order_and_nothing_else_comes(tmp_path):
    fill(tmp_path, "frame10.png", "frame2.PNG", "frame1.jpg", "._frame1.jpg", "sub/frame3.png")
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / "folder.png").mkdir()
    with open_source(str(tmp_path)) as source:
        assert names(source) == ["frame1.jpg", "frame2.PNG", "frame10.png"]
        assert names(source) == ["frame1.jpg", "frame2.PNG", "frame10.png"]
        assert not source.live
        assert source.count == 3


@pytest.mark.parametrize("what", ["dead link", "pipe", "socket"])
@pytest.mark.parametrize("name", ["7.jpg", "frames.csv"])
def test_what_is_no_file_is_named_and_never_passed_over_nor_waited_for(tmp_path, what, name):
    fill(tmp_path, *(f"{at}.jpg" for at in range(7)), "8.jpg")
    if what == "dead link":
        (tmp_path / name).symlink_to("gone")
    elif what == "pipe":
        os.mkfifo(tmp_path / name)
    else:
        with contextlib.closing(socket.socket(socket.AF_UNIX)) as bound:
            bound.bind(os.path.relpath(tmp_path / name))
    with pytest.raises(SourceError) as refused:
        open_source(str(tmp_path))
    assert str(refused.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(refused.value)
    assert ("link to nothing" in str(refused.value)) == (what == "dead link")


def test_a_link_to_an_image_is_an_image(tmp_path):
    fill(tmp_path, "elsewhere/0.jpg", "1.jpg")
    (tmp_path / "0.jpg").symlink_to("elsewhere/0.jpg")
    with open_source(str(tmp_path)) as source:
        assert names(source) == ["0.jpg", "1.jpg"]


@pytest.mark.parametrize("name", ["/etc/hostname", "../outside.png", "sub/../../outside.png"])
def test_a_table_names_no_file_out_of_the_folder(tmp_path, name):
    folder = tmp_path / "frames"
    folder.mkdir()
    fill(tmp_path, "outside.png")
    fill(folder, "0.png")
    (folder / "frames.csv").write_text(f"file\n0.png\n{name}\n")
    with pytest.raises(SourceError, match=r"frames.csv, line 3: the file .* is not in the folder"):
        open_source(str(folder))


@pytest.mark.parametrize("name", ["one.bag.active", "a.mcap.part", "drive.avi.tmp"])
def test_a_file_that_is_still_being_written_is_no_video(tmp_path, name):
    (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(SourceError, match="is being written"):
        open_source(str(tmp_path / name))


def test_bytes_are_passed_on_as_they_lie_on_the_disk(tmp_path):
    fill(tmp_path, "0.jpg", "1.jpg", "2.jpg")
    cut = (tmp_path / "1.jpg").read_bytes()[:200]
    (tmp_path / "1.jpg").write_bytes(cut)
    frames = list(open_source(str(tmp_path)))
    assert frames[1].image == cut
    with pytest.raises(FrameError):
        decode(frames[1].image)
    assert decode(frames[2].image).mean() == pytest.approx(20, abs=1)


def test_start_and_stride_choose_frames_but_keep_their_index(tmp_path):
    fill(tmp_path, *(f"{at}.png" for at in range(10)))
    source = open_source(str(tmp_path), parts=Parts(start=1, stride=4))
    frames = list(source)
    assert [frame.index for frame in frames] == [1, 5, 9]
    assert [decode(frame.image).mean() for frame in frames] == [10, 50, 90]
    assert source.count == 3


def test_without_stamps_the_rate_is_nominal(tmp_path):
    fill(tmp_path, "0.png", "1.png", "2.png", "3.png", "4.png")
    source = open_source(str(tmp_path), parts=Parts(stride=2))
    assert source.origin is None
    assert [frame.stamp_ns for frame in source] == [0, 200_000_000, 400_000_000]
    assert {(frame.pose, frame.odometry_m) for frame in source} == {(None, None)}


def test_frames_csv_gives_order_stamps_poses_and_odometry(tmp_path):
    fill(tmp_path, "a.png", "left/b.png", "c.png", "unlisted.png")
    (tmp_path / "frames.csv").write_text(
        "\ufefffile, stamp, y, x, yaw, odometry\r\n"
        "c.png, 1700000000.123456789, 2, 1, 0.5, 2.5\r\n"
        "\r\n"
        "a.png, 1700000000.623456789, , , , 2.5\r\n"
        "left/b.png, 1700000001.123456789, -4, 3e0, -1, 1e1\r\n",
        encoding="utf-8",
    )
    source = open_source(str(tmp_path))
    frames = list(source)
    folder = tmp_path.name
    assert [f.name for f in frames] == [
        f"{folder}/c.png",
        f"{folder}/a.png",
        f"{folder}/left/b.png",
    ]
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert frames[0].stamp_ns == 1_700_000_000_123_456_789
    assert [frame.pose for frame in frames] == [Pose(1, 2, 0.5), None, Pose(3, -4, -1)]
    assert [frame.odometry_m for frame in frames] == [2.5, 2.5, 10]
    assert decode(frames[2].image).mean() == 10


def test_frames_csv_may_give_the_order_alone(tmp_path):
    fill(tmp_path, "a.png", "b.png")
    (tmp_path / "frames.csv").write_text("file\nb.png\na.png\n")
    frames = list(open_source(str(tmp_path)))
    named = [(frame.name.rpartition("/")[2], frame.stamp_ns) for frame in frames]
    assert named == [("b.png", 0), ("a.png", 10**8)]


def test_images_that_frames_csv_leaves_out_are_counted(tmp_path, caplog):
    fill(tmp_path, "a.png", "b.png", "c.png")
    (tmp_path / "frames.csv").write_text("file\nb.png\n")
    assert len(list(open_source(str(tmp_path)))) == 1
    assert caplog.messages == [f"{tmp_path / 'frames.csv'}: leaves out 2 of 3 images"]


@pytest.mark.parametrize(
    ("header", "row"),
    [("x,y", "3,{metres}"), ("latitude,longitude", "{north:.9f},11")],
)
def test_frames_are_spaced_by_their_poses_where_nothing_else_says_how_far_they_are(
    tmp_path, header, row
):
    files = [f"{number}.png" for number in range(9)]
    fill(tmp_path, *files)
    rows = [
        f"{file}," + row.format(metres=2 * at, north=48 + 2 * at / 111_200)
        for at, file in enumerate(files)
    ]
    (tmp_path / "frames.csv").write_text("\n".join([f"file,{header}", *rows]))
    spaced = open_source(str(tmp_path), spacing_m=3.99)
    assert [frame.index for frame in spaced] == [0, 2, 4, 6, 8]


def test_frames_csv_may_leave_out_the_yaw(tmp_path):
    fill(tmp_path, "a.png")
    (tmp_path / "frames.csv").write_text("file,x,y\na.png,1,2\n")
    assert next(iter(open_source(str(tmp_path)))).pose == Pose(1, 2, 0)


def test_without_a_yaw_the_vehicle_looks_where_it_drives(tmp_path):
    fill(tmp_path, "a.png", "b.png", "c.png", "d.png")
    (tmp_path / "frames.csv").write_text("file,x,y\na.png,0,0\nb.png,,\nc.png,0,3\nd.png,-3,3\n")
    yaws = [frame.pose and frame.pose.yaw for frame in open_source(str(tmp_path))]
    assert yaws == [np.pi / 2, None, np.pi, np.pi]


def test_frames_csv_may_say_where_georeferenced_the_frames_were_taken(tmp_path):
    fill(tmp_path, "a.png", "b.png", "c.png")
    (tmp_path / "frames.csv").write_text(
        "file,latitude,longitude,yaw\na.png,,,\nb.png,-27.5,153,0.25\nc.png,-27.499,153.001,1\n"
    )
    source = open_source(str(tmp_path), parts=Parts(start=1, stride=1))
    poses = [frame.pose for frame in source]
    assert source.origin == Origin(-27.5, 153)
    assert poses[0] == Pose(0, 0, 0.25)
    east, north, _ = pymap3d.geodetic2enu(-27.499, 153.001, 0, -27.5, 153, 0)
    assert (poses[1].x, poses[1].y, poses[1].yaw) == pytest.approx((east, north, 1))


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ("file,x,y,latitude,longitude\na.png,1,2,3,4\n", "line 1: give x and y, or latitude"),
        ("file,latitude,y\na.png,1,2\n", "line 1: give x and y, or latitude"),
        ("file,latitude\na.png,1\n", "line 1: a pose"),
        (
            "file,latitude,longitude\na.png,91,0\n",
            "latitude 91, longitude 0: beyond 90 or 180 degrees",
        ),
        ("file,latitude,longitude\na.png,1,\n", "line 2: longitude is ''"),
        ("", "line 1: the header"),
        ("stamp,x,y\n1,2,3\n", "line 1: the header"),
        ("file,time\na.png,1\n", "line 1: the header"),
        ("file,stamp,stamp\na.png,1,1\n", "line 1: the header"),
        ("file,x\na.png,1\n", "line 1: a pose"),
        ("file,yaw\na.png,1\n", "line 1: a pose"),
        ("file\n", "no frames"),
        ("file,stamp\na.png,1\na.png\n", "line 3: has 1 cells"),
        ("file,stamp\na.png,1\n\na.png,2,3\n", "line 4: has 3 cells"),
        ("file,stamp\na.png,soon\n", "line 2: the stamp 'soon'"),
        ("file,stamp\na.png,\n", "line 2: the stamp ''"),
        ("file,stamp\na.png,nan\n", "line 2: the stamp"),
        ("file,stamp\na.png,inf\n", "line 2: the stamp"),
        ("file,stamp\na.png,1e999999\n", "line 2: the stamp"),
        ("file,stamp\na.png,1700000000123456789\n", "line 2: the stamp"),
        ("file,stamp\na.png,2\na.png,1\n", "line 3: the stamp is earlier"),
        ("file,odometry\na.png,far\n", "line 2: odometry is 'far'"),
        ("file,odometry\na.png,\n", "line 2: odometry is ''"),
        ("file,odometry\na.png,nan\n", "line 2: odometry is 'nan'"),
        ("file,odometry\na.png,1\na.png,0\n", "line 3: the odometry is less"),
        ("file,odometry\na.png,-1\n", "line 2: the odometry is -1, less than 0"),
        ("file,x,y,yaw\na.png,1,2,\n", "line 2: yaw is ''"),
        ("file,x,y\na.png,1,east\n", "line 2: y is 'east'"),
        ("file,x,y\na.png,nan,1\n", "line 2: x is 'nan'"),
        ("file\na.png\nmissing.png\n", "line 3: there is no file 'missing.png'"),
        ('file\n"a.png', "cannot be read as a table"),
        ("file\n\xff.png", "cannot be read as a table"),
    ],
)
def test_a_malformed_frames_csv_is_refused(tmp_path, table, complaint):
    fill(tmp_path, "a.png")
    (tmp_path / "frames.csv").write_bytes(table.encode("latin-1"))
    with pytest.raises(SourceError, match=complaint) as refused:
        open_source(str(tmp_path))
    assert "frames.csv" in str(refused.value)
    assert "\n" not in str(refused.value)


@given(st.lists(st.lists(CELLS, max_size=4).map(",".join), max_size=4).map("\n".join))
def test_no_frames_csv_gives_anything_but_a_listing_or_a_source_error(tmp_path_factory, text):
    folder = tmp_path_factory.getbasetemp() / "tables"
    folder.mkdir(exist_ok=True)
    fill(folder, "a.png")
    (folder / "frames.csv").write_text(text)
    with contextlib.suppress(SourceError):
        listing = read_frames_csv(folder / "frames.csv", lambda index: index)
        assert {frame.file for frame in listing.frames} == {"a.png"}


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r"\.jpg .*\.png") as refused:
        open_source(str(tmp_path))
    assert str(tmp_path) in str(refused.value)


def test_a_start_beyond_the_end_is_refused(tmp_path):
    fill(tmp_path, "0.png", "1.png")
    assert names(open_source(str(tmp_path), parts=Parts(start=1))) == ["1.png"]
    with pytest.raises(SourceError, match=r"--start 2.* 2 frames"):
        open_source(str(tmp_path), parts=Parts(start=2))


def test_a_file_that_goes_away_is_a_known_error(tmp_path):
    fill(tmp_path, "0.png", "1.png")
    source = open_source(str(tmp_path))
    (tmp_path / "1.png").unlink()
    with pytest.raises(SourceError, match=r"1\.png"):
        list(source)
