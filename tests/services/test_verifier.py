"""A verifier gives each smoothed match one verified match, whatever comes or dies."""

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from bus_doubles import PeerCache, RecordingPublisher, at_last, header, received

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import FrameMessage, SmoothedMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.bus.verified_messages import VerifiedMessage
from placefield.config import Config, InferenceConfig
from placefield.errors import ConfigError, MessageError, OtherMapError
from placefield.features.frames import Frame
from placefield.fusion.match import SmoothedMatch
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.verification.inlier_model import STATES
from placefield.verification.place_features import NO_PAIRS
from placefield.verification.verification_stage import VerificationStage
from placefield_services import verifier_run as run_module
from placefield_services.kept_frames import KeptFrame, KeptFrames
from placefield_services.live_verifiers import LiveVerifiers
from placefield_services.map_versions import MapVersions
from placefield_services.verified_versions import VerifiedVersions
from placefield_services.verifier_run import VerifierLinks, VerifierRun
from placefield_tools.evaluate.observing import observer
from placefield_tools.evaluate.verified import verified_matches

KEYS = Keys("test")
CONFIG = Config.model_validate({"verification": {"focal": 0.9}})


@pytest.fixture(autouse=True)
def wait_for_no_frame_and_help_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "_LATE_S", 0.0)
    monkeypatch.setattr(run_module, "_OVERDUE_S", math.inf)


@pytest.fixture(scope="session")
def verified_map(verified_map_path: Path) -> Map:
    return open_map(verified_map_path)


@pytest.fixture(scope="session")
def images(query_dir: Path) -> list[bytes]:
    return [file.read_bytes() for file in sorted(query_dir.iterdir())[:20]]


def smoothed(placemap: Map, place: int, probability: float | None = 0.9) -> SmoothedMessage:
    return SmoothedMessage(
        map=placemap.digest, place=place, score=2.0, probability=probability, known=False, lag=3
    )


class Verifier:
    """A verifier with its published messages and its counts."""

    def __init__(self, path: Path, own: str = "a", elders: Sequence[str] = ()) -> None:
        self.publisher = RecordingPublisher(VerifiedMessage)
        self.smoothed_elsewhere, self.verified_elsewhere = PeerCache(), PeerCache()
        self.counts: Counter[str] = Counter()
        self.live = LiveVerifiers(own, elders)
        for elder in elders:
            self.change(elder, is_alive=True)
        served = VerifiedVersions(MapVersions(path), CONFIG)
        links = VerifierLinks(
            CachedPublisher(self.publisher, ReplayCache()),
            self.smoothed_elsewhere.fetch,
            self.verified_elsewhere.fetch,
        )
        self._run = VerifierRun(KEYS, partial(served.find, "test"), self.live, links, self.counts)

    def change(self, identity: str, *, is_alive: bool) -> None:
        self.live.change(KEYS.alive("verifier", identity), is_alive)

    def accept(self, message: Received) -> None:
        at_last(lambda: self._run.accept(message))

    def send_frame(self, sequence: int, frame: FrameMessage | bytes, *, live: bool = False) -> None:
        message = frame if isinstance(frame, FrameMessage) else FrameMessage(image=frame)
        self.accept(received(KEYS.frame, header(sequence, live=live), message))

    def send_match(
        self, sequence: int, match: SmoothedMessage | bytes, *, live: bool = False
    ) -> None:
        self.accept(received(KEYS.smoothed, header(sequence, live=live), match))

    def send(self, images: Sequence[bytes], placemap: Map) -> None:
        """Send the first frames of a drive, and their matches: all right but for the last one."""
        for number, image in enumerate(images):
            self.send_frame(number, image)
            last = number == len(images) - 1
            self.send_match(number, smoothed(placemap, 40 if last else number))

    def send_verified(self, sequence: int, message: VerifiedMessage) -> None:
        self.accept(received(KEYS.verified, header(sequence), message))

    def verify(self) -> list[int]:
        """Verify all that falls to it; return the numbers of the frames."""
        before = len(self.publisher.sent)
        self._run.ask_if_quiet()
        while self._run.verify_next():
            pass
        return self.publisher.sequences[before:]

    def receive(self, other: "Verifier", *, lost: Sequence[int] = ()) -> None:
        """Receive what another verifier published, but for the frames that are lost."""
        for about, message in other.publisher.sent:
            assert isinstance(message, VerifiedMessage)
            if about.sequence not in lost:
                self.send_verified(about.sequence, message)

    @property
    def sent(self) -> dict[int, bytes]:
        """The published messages by frame."""
        return {
            about.sequence: message.encode() for about, message in self.publisher.sent if message
        }

    @property
    def answers(self) -> list[VerifiedMessage]:
        found = [message for _, message in self.publisher.sent]
        return [message for message in found if isinstance(message, VerifiedMessage)]


@pytest.fixture(scope="session")
def by_one(verified_map_path: Path, verified_map: Map, images: list[bytes]) -> dict[int, bytes]:
    """The messages of one verifier, by frame."""
    verifier = Verifier(verified_map_path)
    verifier.send(images, verified_map)
    assert verifier.verify() == list(range(len(images)))
    return verifier.sent


def test_its_answers_are_those_of_evaluate_to_the_bit(
    by_one: dict[int, bytes], verified_map: Map, images: list[bytes]
) -> None:
    observe = observer(verified_map, InferenceConfig())
    local = [observe(Frame(0, 0, "", image)).local_features for image in images]
    places = [*range(len(images) - 1), 40]
    matches = [
        SmoothedMatch(at, smoothed(verified_map, place).match, 3) for at, place in enumerate(places)
    ]
    expected = verified_matches(VerificationStage(verified_map, CONFIG), matches, local)
    answers = [VerifiedMessage.decode(by_one[number]) for number in range(len(images))]
    assert [answer.match for answer in answers] == [each.match for each in expected]
    *right, wrong = [answer.ratio or 0 for answer in answers]
    assert min(right) > 1
    assert wrong < max(right) / 10


def test_a_verified_match_has_the_relative_pose_that_the_images_determine(
    verified_map_path: Path, verified_map: Map, reference_dir: Path
) -> None:
    verifier = Verifier(verified_map_path)
    files = sorted(reference_dir.iterdir())
    verifier.send_frame(0, files[21].read_bytes())
    verifier.send_match(0, smoothed(verified_map, 20))
    verifier.verify()
    (answer,) = verifier.answers
    assert answer.relative is not None
    # the wall is flat and the camera moves along it: it turns no way but about its own place
    assert np.allclose(np.diag(answer.relative.rotation), 1, atol=0.1)
    assert answer.relative.distance_m is None  # the map has no metres


def test_a_match_that_cannot_be_verified_stays_as_it_is_and_says_why(
    verified_map_path: Path, verified_map: Map, images: list[bytes]
) -> None:
    verifier = Verifier(verified_map_path)
    frames: list[FrameMessage | bytes] = [
        *images[:3],
        FrameMessage(descriptor=np.ones(3, np.float32)),
        b"no image",
    ]
    for number, frame in enumerate(frames):
        verifier.send_frame(number, frame)
    matches = [
        smoothed(verified_map, 0, 0.05),
        smoothed(verified_map, 1, None),
        smoothed(verified_map, -1),
        *(smoothed(verified_map, number) for number in (3, 4, 5)),
    ]
    for number, match in enumerate(matches):
        verifier.send_match(number, match)
    assert verifier.verify() == [0, 1, 2, 3, 4, 5]
    reasons = ["unlikely", "unlikely", "unlikely", "no_image", "unreadable", "no_frame"]
    assert [answer.reason for answer in verifier.answers] == reasons
    assert [answer.match for answer in verifier.answers] == [match.match for match in matches]
    for reason in reasons:
        assert verifier.counts[reason] == reasons.count(reason)


def pair(path: Path) -> tuple[Verifier, Verifier]:
    """Two verifiers that know of each other."""
    one, other = Verifier(path, "a"), Verifier(path, "b")
    one.change("b", is_alive=True)
    other.change("a", is_alive=True)
    return one, other


def test_two_verifiers_share_the_frames_and_publish_in_order_what_one_alone_would(
    verified_map_path: Path, verified_map: Map, images: list[bytes], by_one: dict[int, bytes]
) -> None:
    one, other = pair(verified_map_path)
    for each in (one, other):
        each.send(images, verified_map)
    assert other.verify() == []  # it has compared them, and waits
    assert one.verify() == [*range(8)]
    other.receive(one)
    assert other.verify() == [*range(8, 16)]
    one.receive(other)
    assert one.verify() == [*range(16, 20)]
    assert one.sent | other.sent == by_one
    assert one.counts["verified"] + other.counts["verified"] == len(images)


@pytest.mark.parametrize("arrived", [0, 5, 8])
def test_one_takes_over_what_another_leaves_that_dies(
    verified_map_path: Path,
    verified_map: Map,
    images: list[bytes],
    by_one: dict[int, bytes],
    arrived: int,
) -> None:
    one, other = pair(verified_map_path)
    for each in (one, other):
        each.send(images, verified_map)
    one.verify()
    other.receive(one, lost=range(arrived, 8))
    other.change("a", is_alive=False)
    assert other.verify() == [*range(arrived, 20)]
    assert other.sent == {at: message for at, message in by_one.items() if at >= arrived}


def test_a_lost_message_of_another_holds_up_none_that_is_later(
    verified_map_path: Path, verified_map: Map, images: list[bytes], by_one: dict[int, bytes]
) -> None:
    one, other = pair(verified_map_path)
    for each in (one, other):
        each.send(images, verified_map)
    one.verify()
    other.receive(one, lost=[3])
    assert other.verify() == [*range(8, 16)]
    assert other.sent == {at: by_one[at] for at in range(8, 16)}


def test_a_verified_match_of_a_frame_that_is_not_here_yet_changes_no_other(
    verified_map_path: Path, verified_map: Map, images: list[bytes], by_one: dict[int, bytes]
) -> None:
    verifier = Verifier(verified_map_path)
    forged = VerifiedMessage.decode(by_one[19]).model_copy(update={"posterior": np.eye(STATES)[2]})
    verifier.send_verified(10**6, forged)
    verifier.send(images, verified_map)
    verifier.verify()
    assert verifier.sent == by_one


def test_what_is_overdue_is_taken_over_when_nothing_comes_from_another_verifier(
    verified_map_path: Path,
    verified_map: Map,
    images: list[bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    verifier = Verifier(verified_map_path, "a", ["hanging"])
    for number, image in enumerate(images[:12]):
        if number != 9:
            verifier.send_frame(number, image)
        verifier.send_match(number, smoothed(verified_map, number))
    assert verifier.verify() == [*range(8)]
    monkeypatch.setattr(run_module, "_OVERDUE_S", 0.0)
    assert verifier.verify() == [*range(8, 12)]
    reasons = [answer.reason for answer in verifier.answers]
    assert reasons == [None] * 9 + ["no_frame"] + [None] * 2


def test_an_idle_verifier_helps_a_slow_one(
    verified_map_path: Path,
    verified_map: Map,
    images: list[bytes],
    by_one: dict[int, bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, slow = pair(verified_map_path)
    for each in (one, slow):
        each.send(images, verified_map)
    one.verify()
    slow.receive(one)
    slow.verify()
    monkeypatch.setattr(run_module, "_OVERDUE_S", 0.2)
    time.sleep(0.2)
    one.receive(slow, lost=range(9, 16))
    assert one.verify() == [*range(9, 20)]
    assert one.sent.items() <= by_one.items()


def test_one_that_joins_continues_from_the_messages_of_those_before(
    verified_map_path: Path, verified_map: Map, images: list[bytes], by_one: dict[int, bytes]
) -> None:
    old, new = Verifier(verified_map_path, "b"), Verifier(verified_map_path, "a", ["b"])
    old.send(images[:3], verified_map)
    for number, match in enumerate([0, 1, 40]):
        message = smoothed(verified_map, match).encode()
        new.smoothed_elsewhere.kept[number] = header(number), message
    new.verified_elsewhere.kept[0] = header(0), by_one[0]
    old.change("a", is_alive=True)
    for one in (old, new):
        one.send_frame(3, images[3])
        one.send_match(3, smoothed(verified_map, 3))
    assert new.verify() == []  # number 3 is its own, and waits for those before
    assert old.verify() == [0, 1, 2]
    new.receive(old)
    assert new.verify() == [3]
    after = VerifiedMessage.decode(old.sent[2]).posterior
    assert after is not None
    stage = VerificationStage(verified_map, CONFIG)
    (answer,) = new.answers
    expected = stage.verify(smoothed(verified_map, 3).match, answer.inliers, after)
    assert (answer.match, answer.ratio) == (expected.match, expected.ratio)
    assert new.counts["gaps"] == 0


def test_the_oldest_verifier_answers_for_frames_that_nobody_has(
    verified_map_path: Path, verified_map: Map, images: list[bytes], by_one: dict[int, bytes]
) -> None:
    verifier = Verifier(verified_map_path, "a", ["b"])
    for number in range(3):
        message = smoothed(verified_map, number).encode()
        verifier.smoothed_elsewhere.kept[number] = header(number), message
    verifier.verified_elsewhere.kept[0] = header(0), by_one[0]
    verifier.send_frame(3, images[3])
    verifier.send_match(3, smoothed(verified_map, 3))
    assert verifier.verify() == []
    verifier.change("b", is_alive=False)
    assert verifier.verify() == [1, 2, 3]
    assert [answer.reason for answer in verifier.answers] == ["no_frame", "no_frame", None]
    first = VerifiedMessage.decode(by_one[0]).posterior
    assert verifier.answers[2].ratio == pytest.approx(
        VerificationStage(verified_map, CONFIG)
        .verify(smoothed(verified_map, 3).match, verifier.answers[2].inliers, first, 3)
        .ratio
    )


def test_one_that_joins_alone_counts_what_it_missed(
    verified_map_path: Path, verified_map: Map, images: list[bytes]
) -> None:
    verifier = Verifier(verified_map_path)
    verifier.send_frame(7, images[7])
    verifier.send_match(7, smoothed(verified_map, 7))
    assert verifier.verify() == [7]
    assert verifier.counts["gaps"] == 7


def test_a_live_stream_has_gaps_and_a_lossless_one_has_its_missed_matches_fetched(
    verified_map_path: Path, verified_map: Map, images: list[bytes]
) -> None:
    for live in (True, False):
        verifier = Verifier(verified_map_path)
        for number in (0, 1, 2, 3):
            verifier.send_frame(number, images[number], live=live)
            match = smoothed(verified_map, number)
            verifier.smoothed_elsewhere.kept[number] = header(number, live=live), match.encode()
            if number in (0, 3):
                verifier.send_match(number, match, live=live)
        assert verifier.verify() == ([0, 3] if live else [0, 1, 2, 3])
        assert verifier.counts["gaps"] == (2 if live else 0)


def test_the_last_matches_are_fetched_if_they_were_lost(
    verified_map_path: Path,
    verified_map: Map,
    images: list[bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_module, "_QUIET_S", 0.0)
    verifier = Verifier(verified_map_path)
    verifier.send_frame(0, images[0])
    verifier.send_match(0, smoothed(verified_map, 0))
    for number in (1, 3):  # 2 is in no replay cache
        message = smoothed(verified_map, number).encode()
        verifier.smoothed_elsewhere.kept[number] = header(number), message
    verifier.smoothed_elsewhere.kept[4] = header(4, end=True), b""
    found: list[int] = []
    for _ in range(1000):
        found += verifier.verify()
        if len(found) == 3:
            break
        time.sleep(0.01)  # the answer comes in another thread
    assert found == [0, 1, 3]
    assert [answer.reason for answer in verifier.answers] == [None, "no_frame", "no_frame"]
    assert verifier.counts["gaps"] == 1
    assert verifier.counts["malformed"] == 0


def test_what_came_and_what_was_verified_is_not_verified_again(
    verified_map_path: Path, verified_map: Map, images: list[bytes]
) -> None:
    verifier = Verifier(verified_map_path)
    match = smoothed(verified_map, 0)
    verifier.send_frame(0, images[0])
    verifier.send_match(0, match)
    assert verifier.verify() == [0]
    verifier.send_frame(0, images[0])
    verifier.send_match(0, match)
    early = VerifiedMessage.of(match.match, map=match.map, lag=3, reason="failed")
    verifier.send_verified(1, early)
    verifier.send_match(1, match)
    assert verifier.verify() == []
    assert verifier.counts["repeated"] == 1


def test_hostile_messages_are_refused_and_harm_no_other(
    verified_map_path: Path, verified_map: Map, images: list[bytes]
) -> None:
    verifier = Verifier(verified_map_path)
    beyond = smoothed(verified_map, verified_map.places.count)
    foreign = smoothed(verified_map, 0).model_copy(update={"map": "0123456789abcdef"})
    for match in (b"\x81", b"", beyond, foreign):
        with pytest.raises(MessageError):
            verifier.send_match(0, match)
    with pytest.raises(OtherMapError):
        verifier.send_match(0, foreign)
    for key in (KEYS.frame, KEYS.verified):
        with pytest.raises(MessageError):
            verifier.accept(received(key, header(0), b"\x81"))
    # an image of one pixel is no defect
    verifier.send_frame(0, FrameMessage(image=np.zeros((1, 1), np.uint8)))
    verifier.send_frame(1, images[1])
    for number in range(2):
        verifier.send_match(number, smoothed(verified_map, number))
    assert verifier.verify() == [0, 1]
    assert verifier.counts["verified"] == 2


def test_matches_of_a_new_version_of_the_map_are_verified_by_it_and_late_ones_by_the_one_before(
    tmp_path: Path, verified_map_path: Path, verified_map: Map, images: list[bytes]
) -> None:
    path = Path(copytree(verified_map_path, tmp_path / "served.pfmap"))
    verifier = Verifier(path)
    for number in range(3):
        verifier.send_frame(number, images[number])
    verifier.send_match(0, smoothed(verified_map, 0))
    assert verified_map.local_features is not None
    older = replace(verified_map.local_features, ratios=np.array([7.0]), by_chance=NO_PAIRS)
    save_map(replace(verified_map, local_features=older), path)
    verifier.send_match(1, smoothed(verified_map, 1))
    verifier.send_match(2, smoothed(open_map(path), 2))
    assert verifier.verify() == [0, 1, 2]
    assert [answer.ratio == 7 for answer in verifier.answers] == [False, False, True]
    assert verifier.answers[2].map == open_map(path).digest != verified_map.digest


def test_a_new_version_whose_network_cannot_run_is_refused_and_the_one_before_goes_on(
    tmp_path: Path, verified_map_path: Path, verified_map: Map
) -> None:
    path = Path(copytree(verified_map_path, tmp_path / "served.pfmap"))
    served = VerifiedVersions(MapVersions(path), CONFIG)
    assert verified_map.local_features is not None
    bad = replace(verified_map.local_features, onnx=np.arange(9, dtype=np.uint8))
    save_map(replace(verified_map, local_features=bad), path)
    with pytest.raises(OtherMapError, match=r"no network that onnxruntime can run"):
        served.find("default", open_map(path).digest)
    assert served.find("default", verified_map.digest).digest == verified_map.digest


def test_the_oldest_frames_are_dropped_when_there_are_too_many_bytes() -> None:
    frames = KeptFrames(5000)
    for number in range(3):
        frames.keep(("s", number), KeptFrame(Frame(number, 0, "", bytes(1000)), frozenset()))
    frames.keep(("s", 2), KeptFrame(Frame(2, 0, "", bytes(4000)), frozenset()))  # sent again
    assert [frames.find(("s", number)) is not None for number in range(3)] == [False, True, True]
    frames.drop_before(("s", 2), [])
    assert frames.find(("s", 1)) is None
    frames.keep(("s", 3), KeptFrame(Frame(3, 0, ""), frozenset()))
    assert frames.find(("s", 2)) is not None


def test_a_map_without_local_features_and_a_rule_without_probabilities_are_refused(
    map_path: Path, verified_map_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"route\.pfmap: has no local features.*build"):
        VerifiedVersions(MapVersions(map_path), CONFIG)
    rule = Config.model_validate({"matching": {"rule": "ams"}})
    with pytest.raises(ConfigError, match="rule ams: gives no probability"):
        VerifiedVersions(MapVersions(verified_map_path), rule)
