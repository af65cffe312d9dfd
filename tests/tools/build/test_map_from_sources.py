from pathlib import Path
from shutil import copytree, ignore_patterns

import cv2
import numpy as np
import pytest
from frame_folders import first_frames, uneven_drive
from networks import write_network

from placefield.config import Config
from placefield.errors import MapError, PlacefieldError, SourceError
from placefield.features.extract import feature_of
from placefield.features.images import decode
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.recognizer import Recognizer
from placefield_tools.build.map_from_sources import build_from, map_of
from placefield_tools.sources import Parts, camera

IDENTITY = Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}})
LEARNED = Config.model_validate({"scales": {"channels": 1}, "metric": {"steps": 3}})


def test_the_places_are_the_frames_of_the_first_reference_in_their_order(
    reference_dir: Path, query_dir: Path
) -> None:
    built = build_from([str(reference_dir), str(query_dir)], IDENTITY)
    assert built.places.count == 60
    assert [traverse.name for traverse in built.traverses] == [str(reference_dir), str(query_dir)]
    for place, file in list(enumerate(sorted(reference_dir.iterdir())))[::13]:
        thumbnail = decode(built.places.thumbnail(place)).astype(int)
        assert np.abs(thumbnail - decode(file.read_bytes())).mean() < 8


def test_the_same_frames_and_seed_give_the_same_map(reference_dir: Path) -> None:
    one, other = (build_from([str(reference_dir)], LEARNED) for _ in range(2))
    for array in ("labels", "segments", "scales", "curve"):
        assert np.array_equal(getattr(one.channels[0], array), getattr(other.channels[0], array))
    for array in ("projection", "places"):
        first, second = one.channels[0].metric, other.channels[0].metric
        assert np.array_equal(getattr(first, array), getattr(second, array))
    assert np.array_equal(one.model.components, other.model.components)


@pytest.mark.parametrize("config", [IDENTITY, LEARNED], ids=["identity", "lmnn"])
def test_a_damaged_frame_ends_the_build_and_is_named(
    reference_dir: Path, tmp_path: Path, config: Config
) -> None:
    damaged = copytree(reference_dir, tmp_path / "reference")
    file = damaged / "0031.jpg"
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(SourceError, match=r"0031\.jpg: .*cut off.*or give --leave-out-bad"):
        build_from([str(damaged)], config)


def damage(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-200])


def test_a_frame_that_is_bad_in_one_traverse_is_left_out_of_all_where_that_is_asked_for(
    reference_dir: Path, query_dir: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    one, other = copytree(reference_dir, tmp_path / "a"), copytree(query_dir, tmp_path / "b")
    for file in (one / "0031.jpg", one / "0050.jpg", other / "0002.jpg"):
        damage(file)
    built = build_from([str(one), str(other)], IDENTITY, leave_out_bad=True)
    whole = build_from([str(reference_dir), str(query_dir)], IDENTITY)
    kept = [place for place in range(60) if place not in (2, 31, 50)]
    np.testing.assert_array_equal(built.places.stamps, whole.places.stamps[kept])
    for place, old in enumerate(kept):
        assert built.places.thumbnail(place) == whole.places.thumbnail(old)
    assert (
        f"{one}: 2 of 60 frames cannot be read and are left out (the first: a/0031.jpg: "
        in caplog.text
    )
    assert f"{other}: 1 of 60 frames cannot be read and are left out" in caplog.text


def test_where_no_frame_can_be_read_there_is_no_map(reference_dir: Path, tmp_path: Path) -> None:
    damaged = copytree(reference_dir, tmp_path / "reference")
    for file in damaged.iterdir():
        damage(file)
    with pytest.raises(SourceError, match=r"reference: no frame can be read \(reference/0000\.jpg"):
        build_from([str(damaged)], IDENTITY, leave_out_bad=True)


def a_video(path: Path, count: int) -> Path:
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48)
    )
    for frame in np.random.default_rng(1).integers(0, 256, (count, 48, 64, 3), np.uint8):
        writer.write(frame)
    writer.release()
    return path


def test_a_video_that_gives_fewer_frames_than_it_promised_is_refused_unless_they_are_left_out(
    tmp_path: Path,
) -> None:
    video = a_video(tmp_path / "a.avi", 60)
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with pytest.raises(SourceError, match=r"a\.avi: 31 frames are missing; .*--leave-out-bad"):
        build_from([str(video)], IDENTITY)
    assert build_from([str(video)], IDENTITY, leave_out_bad=True).places.count == 29


def test_each_traverse_is_cut_as_asked(reference_dir: Path, query_dir: Path) -> None:
    parts = Parts(start=4, stop=59, stride=2)
    cut = build_from([str(reference_dir), str(query_dir)], IDENTITY, parts=parts)
    whole = build_from([str(reference_dir)], IDENTITY)
    np.testing.assert_array_equal(cut.places.stamps, whole.places.stamps[4:59:2])


@pytest.mark.parametrize("config", [IDENTITY, LEARNED], ids=["identity", "lmnn"])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_a_reference_that_is_too_short_is_refused(
    reference_dir: Path, tmp_path: Path, count: int, config: Config
) -> None:
    short = first_frames(reference_dir, count, tmp_path / "short")
    with pytest.raises(MapError, match=rf"{count} frames .*too (short|few).*more frames"):
        build_from([str(short)], config)


def test_a_traverse_of_another_length_is_aligned(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    short = first_frames(query_dir, 45, tmp_path / "short")
    built = build_from([str(reference_dir), str(short)], IDENTITY)
    assert built.places.count == 60
    record = built.traverses[1]
    assert (record.frames, record.by) == (45, "smoother")
    assert record.aligned is not None
    assert record.aligned > 30


def test_a_bad_frame_is_left_out_of_its_own_traverse_where_these_differ_in_length(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    short = first_frames(query_dir, 45, tmp_path / "short")
    damage(sorted(short.iterdir())[20])
    built = build_from([str(reference_dir), str(short)], IDENTITY, leave_out_bad=True)
    assert built.places.count == 60
    assert built.traverses[1].frames == 44


@pytest.mark.parametrize("kind", ["grayscale", "gist"])
def test_frames_of_any_size_depth_and_alpha_build_a_map(mixed_dir: Path, kind: str) -> None:
    features = IDENTITY.features.model_copy(update={"kind": kind})
    built = build_from([str(mixed_dir)], IDENTITY.model_copy(update={"features": features}))
    assert built.places.count == 60
    assert built.model.kind == kind


def test_an_uneven_drive_builds_the_even_drives_map_when_it_is_spaced(
    reference_dir: Path, tmp_path: Path
) -> None:
    uneven = uneven_drive(reference_dir, tmp_path / "uneven")
    even = build_from([str(reference_dir)], IDENTITY)
    spaced = build_from([str(uneven)], IDENTITY, spacing_m=0.1)
    for one, other in zip(even.channels, spaced.channels, strict=True):
        assert np.array_equal(one.metric.places, other.metric.places)
    assert not len(even.places.travelled)
    np.testing.assert_allclose(spaced.places.travelled, np.arange(60) / 10)
    assert build_from([str(uneven)], LEARNED, spacing_m=0.1).places.count == 60


def test_a_camera_is_no_reference() -> None:
    with pytest.raises(PlacefieldError, match="camera:9"):
        build_from(["camera:9"], IDENTITY)


def test_a_cameras_password_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera.Camera, "__init__", lambda *_, **__: None)
    with pytest.raises(SourceError, match=r"^rtsp://host/s: no map is built from a live camera"):
        build_from(["rtsp://me:secret@host/s"], IDENTITY)


def test_a_map_that_is_there_is_taken_as_it_is(map_path: Path) -> None:
    with map_of(str(map_path), Config(), feature_asked=False) as path:
        assert path == map_path
    with map_of(str(map_path), Config(), feature_asked=True) as path:
        assert path == map_path


def test_a_map_of_another_feature_than_asked_for_is_refused(map_path: Path) -> None:
    config = Config.model_validate({"features": {"kind": "grayscale"}})
    with (
        pytest.raises(MapError, match=rf"{map_path}: holds gist features, not grayscale"),
        map_of(str(map_path), config, feature_asked=True),
    ):
        pass


@pytest.fixture
def network(tmp_path: Path) -> Path:
    write_network(tmp_path / "net.onnx", grid=4)
    return tmp_path / "net.onnx"


def with_network(path: Path, metric: str = "identity") -> Config:
    return Config.model_validate(
        {
            "features": {"kind": f"onnx:{path}"},
            "scales": {"channels": 2},
            "metric": {"kind": metric, "steps": 3},
        }
    )


@pytest.mark.parametrize("metric", ["identity", "lmnn"])
def test_a_map_of_a_network_recognises_without_the_networks_files(
    reference_dir: Path, query_dir: Path, network: Path, tmp_path: Path, metric: str
) -> None:
    path = tmp_path / "route.pfmap"
    save_map(build_from([str(reference_dir)], with_network(network, metric)), path)
    network.unlink()
    network.with_suffix(".toml").unlink()
    recognizer = Recognizer(open_map(path))
    places = [recognizer.update(file.read_bytes()).place for file in sorted(query_dir.iterdir())]
    assert np.mean(np.abs(np.array(places) - range(60)) <= 2) > 0.95


def test_a_map_of_another_network_than_asked_for_is_refused(
    reference_dir: Path, network: Path, map_path: Path, tmp_path: Path
) -> None:
    built = tmp_path / "route.pfmap"
    save_map(build_from([str(reference_dir)], with_network(network)), built)
    moved = tmp_path / "elsewhere" / "same.onnx"
    copytree(network.parent, moved.parent, ignore=ignore_patterns("*.pfmap"))
    for file in sorted(moved.parent.iterdir()):
        file.rename(file.with_stem("same"))
    for path in (network, moved):
        with map_of(str(built), with_network(path), feature_asked=True) as taken:
            assert taken == built
    write_network(network, grid=3)
    for path, reason in [
        (built, rf"holds onnx:{network} features, not onnx:{network} as it is now"),
        (map_path, rf"holds gist features, not onnx:{network}: "),
    ]:
        with (
            pytest.raises(MapError, match=f"{path}: {reason}"),
            map_of(str(path), with_network(network), feature_asked=True),
        ):
            pass


def test_a_map_made_for_the_time_being_is_gone_afterwards(
    reference_dir: Path, route_map: Map
) -> None:
    with map_of(str(reference_dir), IDENTITY, feature_asked=False) as path:
        built = open_map(path)
        image = (reference_dir / "0000.jpg").read_bytes()
        assert len(built.model.mean) == len(feature_of("gist").describe(image))
        assert np.array_equal(built.model.mean, route_map.model.mean)
    assert not path.exists()
    assert not path.parent.exists()
