import struct
from fractions import Fraction

import cv2
import numpy as np
import pytest

from placefield.errors import FrameError, SourceError
from placefield_tools.sources import Parts, open_source

RATE = 25


def brightness(index):
    return 20 * index + 10


def write_video(path, codec="MJPG", count=10):
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), RATE, (64, 48)
    )
    assert writer.isOpened()
    for index in range(count):
        writer.write(np.full((48, 64, 3), brightness(index), np.uint8))
    writer.release()
    return str(path)


NOISE = 60
"""Frames of a video that is large enough to be damaged here and there."""


def write_noise(path, codec):
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), RATE, (64, 48)
    )
    for frame in np.random.default_rng(0).integers(0, 256, (NOISE, 48, 64, 3), np.uint8):
        writer.write(frame)
    writer.release()


@pytest.mark.parametrize(("name", "codec"), [("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_all_frames_come_with_index_and_stamp(tmp_path, name, codec):
    with open_source(write_video(tmp_path / name, codec)) as source:
        assert source.count == 10
        assert not source.live
        frames = list(source)
        assert [frame.index for frame in source] == list(range(10))
    assert [frame.stamp_ns for frame in frames] == [40_000_000 * index for index in range(10)]
    for frame in frames:
        assert frame.image.shape == (48, 64, 3)
        assert frame.image.dtype == np.uint8
        assert frame.image.mean() == pytest.approx(brightness(frame.index), abs=4)
    assert frames[3].name == f"{name}#3"


def test_a_video_keeps_its_own_time_where_its_frames_do_not_come_evenly(tmp_path):
    video = tmp_path / "a.mp4"
    write_video(video, "mp4v", count=6)
    video.write_bytes(uneven(video.read_bytes()))
    stamps = [frame.stamp_ns for frame in open_source(str(video))]
    assert stamps == [1_000_000 * ms for ms in (0, 40, 120, 240, 280, 360)]


def uneven(data):
    """Let a video's frames last for 1, 2, 3, 1, 2 and 3 times as long: ISO 14496-12, 8.6.1.2."""
    boxes, at = b"", 0
    while at < len(data):
        end = at + int.from_bytes(data[at : at + 4], "big")
        kind, content, at = data[at + 4 : at + 8], data[at + 8 : end], end
        if kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
            content = uneven(content)
        elif kind == b"stts":  # one entry: all the frames last as long
            count, ticks = struct.unpack(">8xII", content)
            lasting = [(1, ticks * (1 + frame % 3)) for frame in range(count)]
            content = bytes(4) + struct.pack(f">I{2 * count}I", count, *sum(lasting, ()))
        elif kind == b"edts":  # how long all of it lasts
            continue
        boxes += struct.pack(">I", len(content) + 8) + kind + content
    return boxes


def test_start_and_stride_choose_frames_but_keep_their_index(tmp_path):
    source = open_source(write_video(tmp_path / "a.avi"), parts=Parts(start=2, stride=3))
    frames = list(source)
    assert [frame.index for frame in frames] == [2, 5, 8]
    assert [frame.stamp_ns for frame in frames] == [80_000_000, 200_000_000, 320_000_000]
    assert frames[1].image.mean() == pytest.approx(brightness(5), abs=4)
    assert source.count == 3


def test_a_start_beyond_the_end_is_reported_on_reading(tmp_path):
    source = open_source(write_video(tmp_path / "a.avi"), parts=Parts(start=10))
    with pytest.raises(SourceError, match="--start 10"):
        list(source)


@pytest.mark.parametrize(
    ("parts", "numbers"),
    [
        (Parts(stop=4), range(4)),
        (Parts(start=1, stop=8, stride=3), [1, 4, 7]),
        (Parts(start=8, stop=99), [8, 9]),
    ],
)
def test_a_stop_ends_the_frames_before_it(tmp_path, parts, numbers):
    source = open_source(write_video(tmp_path / "a.avi"), parts=parts)
    assert [frame.index for frame in source] == [*numbers]
    assert source.count == len(numbers)


CONTAINERS = [("a.avi", "MJPG"), ("b.avi", "mp4v"), ("a.mkv", "MJPG"), ("b.mkv", "mp4v")]


@pytest.mark.parametrize(("name", "codec"), CONTAINERS)
def test_what_a_video_that_was_cut_off_lacks_is_counted_and_reported(tmp_path, caplog, name, codec):
    whole = tmp_path / name
    write_noise(whole, codec)
    assert len(list(open_source(str(whole)))) == NOISE
    assert not caplog.records
    cut = tmp_path / f"cut-{name}"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    source = open_source(str(cut))
    given = len(list(source))
    assert 0 < given < NOISE
    assert source.not_given["missing"] == NOISE - given
    assert f"{cut}: {given} frames were read and {NOISE - given} are missing" in caplog.text


@pytest.mark.parametrize(
    ("name", "codec"), [*CONTAINERS, ("a.mp4", "mp4v"), ("b.mp4", "MJPG"), ("c.webm", "VP80")]
)
def test_frames_behind_damage_in_a_video_come_and_none_goes_without_a_word(tmp_path, name, codec):
    whole, damaged = tmp_path / name, tmp_path / f"damaged-{name}"
    write_noise(whole, codec)
    data = bytearray(whole.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 6000] = bytes(6000)
    damaged.write_bytes(data)
    source = open_source(str(damaged))
    frames = list(source)
    bad = [frame for frame in frames if frame.fault]
    assert len(frames) + source.not_given["missing"] == NOISE
    assert bad or source.not_given["missing"]
    *_, last = open_source(str(whole))
    np.testing.assert_array_equal(frames[-1].image, last.image)
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(stamps)
    for frame in bad:
        assert frame.image == b""
        with pytest.raises(FrameError, match="does not decode"):
            frame.pixels()


@pytest.mark.parametrize("name", ["a.avi", "a.mkv", "a.mp4"])
def test_a_whole_video_is_missing_nothing_whatever_part_of_it_is_taken(tmp_path, caplog, name):
    video = write_video(tmp_path / name, "MJPG")
    for parts in (Parts(), Parts(start=3, stride=4), Parts(stop=2)):
        source = open_source(video, parts=parts)
        assert list(source)
        assert source.not_given["missing"] == 0
    assert not caplog.records


@pytest.mark.parametrize(
    "shown_at",
    [
        pytest.param(np.cumsum(np.linspace(0.02, 0.5, 40)), id="uneven"),
        pytest.param(20 + np.arange(40) / 10, id="late"),
        pytest.param(np.arange(40) / 10, id="even"),
    ],
)
@pytest.mark.parametrize("sound_s", [0, 9])
def test_a_whole_matroska_is_missing_nothing_whenever_its_frames_come(
    tmp_path, caplog, shown_at, sound_s
):
    av = pytest.importorskip("av")
    video = tmp_path / "a.mkv"
    with av.open(str(video), "w") as file:
        stream = file.add_stream("mjpeg", rate=10, width=64, height=48, pix_fmt="yuvj420p")
        stream.codec_context.time_base = Fraction(1, 1000)
        sound = file.add_stream("pcm_s16le", rate=8000) if sound_s else None
        for at, second in enumerate(shown_at):
            pixels = np.full((48, 64, 3), 5 * at, np.uint8)
            picture = av.VideoFrame.from_ndarray(pixels, format="bgr24")
            picture.pts, picture.time_base = round(1000 * second), Fraction(1, 1000)
            file.mux(stream.encode(picture))
        file.mux(stream.encode())
        if sound:
            silence = np.zeros((1, 8000 * sound_s), np.int16)
            samples = av.AudioFrame.from_ndarray(silence, format="s16", layout="mono")
            samples.sample_rate = 8000
            file.mux(sound.encode(samples))
            file.mux(sound.encode())
    source = open_source(str(video))
    assert len(list(source)) == len(shown_at)
    assert source.not_given["missing"] == 0
    assert not caplog.records


def test_frames_without_a_container_have_no_count(tmp_path):
    pictures = [cv2.imencode(".jpg", np.full((48, 64), at, np.uint8))[1] for at in range(4)]
    (tmp_path / "raw.mjpeg").write_bytes(b"".join(picture.tobytes() for picture in pictures))
    source = open_source(str(tmp_path / "raw.mjpeg"))
    assert source.count is None
    assert len(list(source)) == 4


def test_frames_are_turned_as_the_container_says(tmp_path):
    video = tmp_path / "a.mp4"
    write_video(video, "mp4v", count=2)
    data = bytearray(video.read_bytes())
    matrix = data.index(b"tkhd") + 4 + 40  # ISO 14496-12, 8.3.2, version 0
    quarter_turn = [0, 1, 0, -1, 0, 0, 0, 0, 0x4000]
    for at, value in enumerate(quarter_turn):
        data[matrix + 4 * at : matrix + 4 * at + 4] = (value << 16).to_bytes(4, "big", signed=True)
    video.write_bytes(data)
    plain = tmp_path / "plain.mp4"
    write_video(plain, "mp4v", count=2)
    stored = next(iter(open_source(str(plain)))).image
    turned = next(iter(open_source(str(video)))).image
    assert stored.shape == (48, 64, 3)
    np.testing.assert_array_equal(turned, np.rot90(stored, -1))


def test_where_no_frame_decodes_the_codec_is_named(tmp_path):
    video = tmp_path / "a.avi"
    write_video(video, "MJPG", count=3)
    data = bytearray(video.read_bytes())
    first, last = data.index(b"\xff\xd8"), data.rindex(b"\xff\xd9")
    data[first:last] = bytes(last - first)
    video.write_bytes(data)
    with pytest.raises(SourceError, match=r"a\.avi: no frame decodes: .* codec, MJPG") as refused:
        list(open_source(str(video)))
    assert "\n" not in str(refused.value)
    assert "ffmpeg -i a.avi" in str(refused.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.mp4", b""), ("a.avi", bytes(5000)), ("a.txt", b"frames are elsewhere\n" * 50)],
)
def test_a_file_that_is_no_video_is_refused(tmp_path, capfd, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SourceError, match=f"{name}: no video"):
        open_source(str(tmp_path / name))
    assert "VIDEOIO" not in capfd.readouterr().err
