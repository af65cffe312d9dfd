"""What all streams of a run share in the fuser, under one version of the map."""

from collections import Counter
from dataclasses import dataclass

from placefield.config import Config
from placefield.fusion.fusion_stage import AnyFusionStage
from placefield_services.candidate_decoder import CandidateDecoder
from placefield_services.live_channels import LiveChannels
from placefield_services.match_publisher import MatchPublisher
from placefield_services.served import Served


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
