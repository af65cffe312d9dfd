"""What channel workers publish, decoded and checked before the fuser uses any of it."""

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage, SmoothedFrame
from placefield.bus.message import Header
from placefield.config import MatchingConfig
from placefield.errors import MessageError
from placefield.fusion.fusion_stage import AnyFusionStage
from placefield.matching.candidate import Candidate


def decode_candidates(header: Header, payload: bytes) -> CandidatesMessage | FinishedMessage:
    """Return a message of a channel worker, unchecked.

    Raises:
        MessageError: it does not parse.
    """
    kind = FinishedMessage if header.end else CandidatesMessage
    return kind.decode(payload)


class CandidateDecoder:
    """Decodes the messages of channel workers; a message is accepted as a whole or not at all."""

    def __init__(self, digest: str, matching: MatchingConfig, stage: AnyFusionStage) -> None:
        """Take the digest of the fuser's own map and its rule, which the workers must have, too."""
        self._digest = digest
        self._matching = matching
        self._stage = stage

    def decode(self, header: Header, payload: bytes) -> CandidatesMessage | FinishedMessage:
        """Return the candidates of a frame, or what a worker smoothed at the end of a stream.

        Raises:
            MessageError: it does not parse, or it is of another map, rule or lag.
        """
        message = decode_candidates(header, payload)
        self.check_message(message)
        return message

    def check_message(self, message: CandidatesMessage | FinishedMessage) -> None:
        """Check the whole of a decoded message.

        Raises:
            MessageError: it is of another map, rule or lag.
        """
        message.check_map(self._digest)
        rule = self._matching.rule
        if message.rule != rule:
            raise MessageError(
                f"candidate of rule {message.rule}, this fuser's is {rule}: give both one --rule"
            )
        for frame in [] if message.smoothed is None else message.smoothed.frames(0):
            self.check_smoothed(frame, message.shards)
        if isinstance(message, CandidatesMessage):
            for each in message.candidates:
                self.check(each.candidate, message.shards)

    def check(self, candidate: Candidate, shards: int = 1) -> None:
        """Check a candidate of a channel, or of one of its shards.

        Raises:
            MessageError: it is of another map.
        """
        if not self._stage.fits(candidate, shards):
            raise MessageError("candidate of another map than this fuser's")

    def check_smoothed(self, frame: SmoothedFrame, shards: int = 1) -> None:
        """Check what a channel, or one of its shards, smoothed.

        Raises:
            MessageError: it is of another map or lag.
        """
        if not self._stage.fits(frame.candidate, shards):
            raise MessageError("smoothed by a channel of another map")
        lag = self._matching.lag
        if frame.lag > lag:
            raise MessageError(
                f"smoothed after {frame.lag} frames, this fuser's lag is {lag}: "
                "give both one matching.lag"
            )
