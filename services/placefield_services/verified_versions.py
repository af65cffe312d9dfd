"""The versions of the map whose matches a verifier verifies."""

from collections.abc import Callable
from typing import NamedTuple

from placefield.config import Config
from placefield.errors import ConfigError, OtherMapError
from placefield.maps.map import Map
from placefield.verification.verification_stage import VerificationStage
from placefield_services.map_versions import MapVersions


class VerifiedVersion(NamedTuple):
    """A version of the map, as a verifier serves it.

    Attributes:
        digest: of the version.
        places: how many it has.
        stage: that verifies its matches.
        check_unchanged: see ``Map``.
    """

    digest: str
    places: int
    stage: VerificationStage
    check_unchanged: Callable[[], None]


class VerifiedVersions:
    """Finds the version that a match names: that of a run, or the newest at the map's path.

    A new version is opened when the first match names it: the fuser goes over to it, and not the
    verifiers.
    """

    def __init__(self, versions: MapVersions, config: Config) -> None:
        """Open the first version.

        Raises:
            MapError: it cannot be opened.
            ConfigError: it has no local features, its network cannot run, or the rule gives no
                probabilities.
        """
        if config.matching.rule != "filter":
            raise ConfigError(
                f"rule {config.matching.rule}: gives no probability to verify; leave the verifiers "
                "out, or use the rule filter"
            )
        self._versions, self._config = versions, config
        first = versions.open()
        if first.local_features is None:
            raise ConfigError(
                f"{versions.path}: has no local features to verify matches with; build it with "
                "--set build.local_features=600"
            )
        self._newest = self._prepared(first)
        self._of_runs: dict[str, VerifiedVersion] = {}

    def find(self, run: str, digest: str) -> VerifiedVersion:
        """Return the version with this digest, which a match of a run names.

        Raises:
            OtherMapError: there is none, or its network cannot run here.
        """
        found = self._known(digest)
        if found is None and (new := self._versions.open_new()) is not None:
            try:
                self._newest = self._prepared(new)
            except ConfigError as error:  # its network of local features cannot run
                raise OtherMapError(f"{self._versions.path}: {error}") from None
            found = self._known(digest)
        if found is None:
            raise OtherMapError(
                f"a match of map {digest}, not {self._newest.digest}; give all services one map"
            )
        self._of_runs[run] = found
        return found

    def _known(self, digest: str) -> VerifiedVersion | None:
        served = (self._newest, *self._of_runs.values())
        return next((version for version in served if version.digest == digest), None)

    def _prepared(self, placemap: Map) -> VerifiedVersion:
        stage = VerificationStage(placemap, self._config)
        count = placemap.places.count
        return VerifiedVersion(placemap.digest, count, stage, placemap.check_unchanged)
