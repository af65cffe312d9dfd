"""Featurizer, describer and fuser while a drive is explored, and what stands for the map meanwhile.

The places are earlier frames of the drive.
"""

import threading
from dataclasses import dataclass

from placefield.config import Config, MatchingConfig
from placefield.errors import ConfigError
from placefield.features.calibration import Calibration
from placefield.features.raw_stage import RawStage, raw_fingerprint
from placefield.features.rectification import view_of
from placefield.fusion.exploration_stage import ExplorationStage
from placefield_services.describer import DescribedFeature, serve_describer
from placefield_services.featurizer import serve_featurizer
from placefield_services.fuser import serve_fuser
from placefield_services.served import FuserVersion


@dataclass(frozen=True)
class Exploration:
    """Stands for a map of one channel.

    Attributes:
        digest: the fingerprint of the feature.
    """

    digest: str
    channels = (0,)

    def check_unchanged(self) -> None:
        """Do nothing: there is no file that could change."""


def run_exploring_featurizer(
    config: Config, camera: Calibration | None, stop: threading.Event
) -> None:
    """Publish raw features until ``stop`` is set.

    Args:
        config: of the services.
        camera: whose view the frames are rectified to; None: they are used as they are.
        stop: ends the service.

    Raises:
        ConfigError: the feature cannot be computed, or the camera has no view.
    """
    digest = raw_fingerprint(config.features.kind, camera)
    serve_featurizer(_stage(config, camera), digest, Exploration(digest), config, stop)


def run_exploring_describer(
    config: Config, camera: Calibration | None, stop: threading.Event
) -> None:
    """Describe a share of the frames until ``stop`` is set, see ``run_exploring_featurizer``.

    Raises:
        ConfigError: the feature cannot be computed, or is given descriptors; or the camera has no
            view.
    """
    digest = raw_fingerprint(config.features.kind, camera)
    feature = DescribedFeature(_stage(config, camera), digest)
    serve_describer(feature, Exploration(digest), config, stop)


def _stage(config: Config, camera: Calibration | None) -> RawStage:
    view = None if camera is None else view_of(camera)
    return RawStage(config.features.kind, view, config.inference)


def run_exploring_fuser(config: Config, camera: Calibration | None, stop: threading.Event) -> None:
    """Publish what explorers answer until ``stop`` is set, see ``run_exploring_featurizer``.

    Raises:
        ConfigError: a file of the network cannot be read, or the rule cannot explore.
    """
    check_exploring(config.matching)
    digest = raw_fingerprint(config.features.kind, camera)
    version = FuserVersion(Exploration(digest), ExplorationStage(config.matching))
    version.stage.warm_up()
    serve_fuser(version, config, stop)


def check_exploring(matching: MatchingConfig) -> None:
    """Refuse a rule that cannot explore.

    Raises:
        ConfigError: the rule is another than ``filter``.
    """
    if matching.rule != "filter":
        raise ConfigError(f"rule {matching.rule}: cannot explore; leave --rule and --preset out")
