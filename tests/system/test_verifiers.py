"""Verifiers as processes: each smoothed match gets a verified match, though one is killed."""

import signal
from contextlib import ExitStack, suppress
from pathlib import Path

from hosting import Host, Listener, Process, wait_until

from placefield.bus.matches import MatchQueue
from placefield.bus.messages import SmoothedMessage
from placefield.bus.verified_messages import VerifiedMessage
from placefield.config import Config, InferenceConfig
from placefield.errors import MessageError
from placefield.features.frames import Frame
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.opening import open_map
from placefield.recognizer import Recognizer
from placefield.verification.verification_stage import VerificationStage
from placefield_tools.evaluate.observing import observer
from placefield_tools.evaluate.verified import verified_matches
from placefield_tools.record.records import read_records

FRAMES, STRIDE = 20, 3
EVERY_THIRD = ("--stride", str(STRIDE))


def offline(map_path: Path, files: list[Path]) -> list[Match]:
    """Return what evaluate makes of the same frames, with no bus."""
    placemap, config = open_map(map_path), Config()
    recognizer = Recognizer(placemap, config)
    observe = observer(placemap, InferenceConfig())
    for file in files:
        recognizer.update(file.read_bytes())
    local = [observe(Frame(0, 0, "", file.read_bytes())).local_features for file in files]
    matches: list[SmoothedMatch] = recognizer.smoothed() + recognizer.finish()
    stage = VerificationStage(placemap, config)
    return [each.match for each in verified_matches(stage, matches, local)]


def until_verified(queue: MatchQueue) -> dict[int, VerifiedMessage]:
    """Receive until each frame has a verified match; return them by frame."""
    found: dict[int, VerifiedMessage] = {}

    def receive() -> bool:
        with suppress(MessageError):  # of garbage
            received = queue.get(0.1)
            if received is not None and isinstance(received[1], VerifiedMessage):
                assert received[0].sequence not in found, "a frame comes twice"
                found[received[0].sequence] = received[1]
        return len(found) == FRAMES

    wait_until(receive, "all frames are verified")
    return found


def test_while_one_of_two_verifiers_is_killed_each_smoothed_match_is_verified_once_for_readers(
    tmp_path: Path, verified_map_path: Path, query_dir: Path
) -> None:
    files = sorted(query_dir.iterdir())[::STRIDE]
    with ExitStack() as stack:
        enter = stack.enter_context
        host = enter(Host(tmp_path, verified_map_path, "--workers", "1", "--verifiers", "1"))
        at = ("--endpoint", host.endpoint)
        listener: Listener = enter(host.listener())
        second = enter(Process(tmp_path, "verifier", verified_map_path, *at))
        wait_until(lambda: len(listener.alive("verifier")) == 2, "both verifiers")
        queue = MatchQueue(listener.bus, listener.keys, smoothed=True, verified=True)
        file = tmp_path / "drive.jsonl"
        record = enter(Process(tmp_path, "record", file, *at))
        wait_until(lambda: "recording" in record.out, "the recording")
        enter(Process(tmp_path, "replay", query_dir, *EVERY_THIRD, "--rate", "4", *at))
        listener.answers(count=FRAMES // 2)
        second.stop(signal.SIGKILL)
        found = until_verified(queue)
        matches = listener.smoothed(listener.answers(first=FRAMES // 2)[0][0].stream)
        assert len(matches) == FRAMES
        verified = [found[number].match for number in range(FRAMES)]
        assert verified == offline(verified_map_path, files)
        wait_until(lambda: file.read_text().count('"verified": true') == FRAMES, "all on file")
        record.stop(signal.SIGINT)
        assert f"{FRAMES} smoothed, {FRAMES} verified" in record.out
    recorded = {
        (record.header.sequence, record.match.inliers)
        for record in read_records(file)
        if isinstance(record.match, VerifiedMessage)
    }
    assert recorded == {(number, found[number].inliers) for number in found}


def test_matches_do_not_wait_for_a_verifier_that_hangs_and_garbage_does_not_stop_it(
    tmp_path: Path, verified_map_path: Path, query_dir: Path
) -> None:
    with Host(tmp_path, verified_map_path, "--workers", "1", "--verifiers", "1") as host:
        (verifier,) = host.service("verifier")
        with host.listener() as listener:
            queue = MatchQueue(listener.bus, listener.keys, verified=True)
            at = ("--endpoint", host.endpoint)
            with Process(tmp_path, "replay", query_dir, *EVERY_THIRD, "--rate", "4", *at):
                wait_until(lambda: listener.count("verifier", "streams"), "it follows the stream")
                verifier.suspend()
                answers = listener.answers()
            matches = listener.smoothed(answers[0][0].stream)
            verifier.resume()
            for key in (listener.keys.frame, listener.keys.smoothed, listener.keys.verified):
                put = listener.bus.publisher(key).send
                for garbage in (b"\xc1", b"", answers[0][1].encode()):
                    put(answers[-1][0], garbage)
            found = until_verified(queue)
            # not 9: what comes of a frame that is verified is not read
            wait_until(lambda: listener.count("verifier", "malformed") >= 3, "garbage is counted")
            assert listener.count("verifier", "failed") == 0
        assert "Traceback" not in host.err
    assert len(matches) == FRAMES
    assert all(isinstance(match, SmoothedMessage) for _, match in matches)
    # if it hung for so long that its session was over, frames are lost
    assert {match.reason for match in found.values()} <= {None, "no_frame"}
