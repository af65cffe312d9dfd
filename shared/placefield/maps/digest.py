"""What tells one map from another."""

import hashlib

DIGEST_LENGTH = 16
"""Hexadecimal digits."""

NO_DIGEST = "0" * DIGEST_LENGTH
"""Stands for the digest of a map that is not on disk, or that an old recording does not name."""


def short_digest(written: bytes) -> str:
    """Return which map a manifest is of, as it is written: the first digits of its SHA-256.

    The manifest has the checksums of all files, so that no two maps share one.
    """
    return hashlib.sha256(written).hexdigest()[:DIGEST_LENGTH]
