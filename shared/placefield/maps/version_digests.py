"""The digests of a map and of its other versions."""

from pathlib import Path

from placefield.errors import MapError
from placefield.maps.manifest import MANIFEST, Manifest, read_identified


class VersionDigests:
    """The digests of the versions of the map at a path, also of those that replace it there.

    A version has the lineage and the coordinate frame of the first one. The manifest of a version
    names those before it, so none is missed, however fast they follow each other.
    """

    def __init__(self, path: Path) -> None:
        """Read the manifest of the map that is there now.

        Raises:
            MapError: see ``read_identified``.
        """
        self._path = path
        self.manifest, digest = read_identified(path)
        self._known = {digest, *_before(self.manifest)}
        self._seen = self._state()

    def __contains__(self, digest: object) -> bool:
        """Whether this is the digest of a version; a new manifest is read if it is not known."""
        if digest not in self._known and self._state() != self._seen:
            self._seen = self._state()
            self._look()
        return digest in self._known

    def _look(self) -> None:
        try:
            new, digest = read_identified(self._path, self.manifest.lineage)
        except MapError:
            return
        if new.pose_frame == self.manifest.pose_frame:
            self._known |= {digest, *_before(new)}

    def _state(self) -> tuple[int, int] | None:
        """Return what tells that another manifest is at the path; None if there is none."""
        try:
            status = (self._path / MANIFEST).stat()
        except OSError:
            return None
        return status.st_ino, status.st_mtime_ns


def _before(manifest: Manifest) -> set[str]:
    return {change.before for change in manifest.history}
