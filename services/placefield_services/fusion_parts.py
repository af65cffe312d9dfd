"""What all streams of a run share in the fuser."""

from collections import Counter
from dataclasses import dataclass

from placefield.config import Config
from placefield.fusion.fusion_stage import AnyFusionStage
from placefield_services.candidate_decoder import CandidateDecoder
from placefield_services.live_channels import LiveChannels
from placefield_services.match_publisher import FuserOutputs, MatchPublisher
from placefield_services.served import FuserVersion, Served


@dataclass(frozen=True)
class RunParts:
    """What all streams of a run share in the fuser, under every version of the map.

    Attributes:
        config: of the fuser.
        channels: which channels there are, and which are alive.
        outputs: where the run's answers are published.
        counts: of the run.
    """

    config: Config
    channels: LiveChannels
    outputs: FuserOutputs
    counts: Counter[str]

    def under(self, version: FuserVersion) -> "FusionParts":
        """Return the parts under a version of the map."""
        served, stage = version
        decoder = CandidateDecoder(served.digest, self.config.matching, stage)
        publisher = MatchPublisher(served, stage, self.outputs, self.counts)
        return FusionParts(
            served, self.config, self.channels, stage, decoder, publisher, self.counts
        )


@dataclass(frozen=True)
class FusionParts:
    """What all streams of a run share in the fuser, under one version of the map.

    Attributes:
        served: the version of the map.
        config: of the fuser.
        channels: which channels there are, and which are alive.
        stage: fuses candidates.
        decoder: decodes and checks what channel workers publish.
        publisher: publishes what was fused.
        counts: of the run.
    """

    served: Served
    config: Config
    channels: LiveChannels
    stage: AnyFusionStage
    decoder: CandidateDecoder
    publisher: MatchPublisher
    counts: Counter[str]
