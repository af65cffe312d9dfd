"""The digest that identifies a map."""

import hashlib

DIGEST_LENGTH = 16
"""Length of a map's digest, hexadecimal digits."""

NO_DIGEST = "0" * DIGEST_LENGTH
"""The digest of a map that was never saved, or of the map of an old recording that names none."""


def short_digest(written: bytes) -> str:
    """Return the digest of a map: the first digits of the SHA-256 of its manifest's bytes.

    The manifest holds the checksums of all files, so two different maps have different digests.
    """
    return hashlib.sha256(written).hexdigest()[:DIGEST_LENGTH]
