"""The digest that identifies a map, and the lineage of its versions."""

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


def lineage_of(model: str, channels: int) -> str:
    """Return the lineage of a map, 16 hexadecimal digits.

    Maps of one lineage are versions of each other: services can go from one to the next.

    Args:
        model: fingerprint of the descriptor model.
        channels: the number of channels.
    """
    return hashlib.sha256(f"{model} {channels}".encode()).hexdigest()[:DIGEST_LENGTH]
