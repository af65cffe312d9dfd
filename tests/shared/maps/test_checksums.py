from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from placefield.maps.checksums import checksum_of

MIB = 2**20


@pytest.mark.parametrize("size", [0, 1, MIB - 1, MIB, MIB + 1, 9 * MIB + 5])
def test_a_checksum_is_of_the_checksums_of_each_mib(tmp_path: Path, size: int) -> None:
    content = np.random.default_rng(0).bytes(size)
    (tmp_path / "file").write_bytes(content)
    pieces = [content[start : start + MIB] for start in range(0, size, MIB)]
    expected = sha256(b"".join(sha256(piece).digest() for piece in pieces)).hexdigest()
    assert checksum_of(tmp_path / "file") == expected


def test_what_cannot_be_read_is_an_error_of_the_disk(tmp_path: Path) -> None:
    for path in (tmp_path / "missing", tmp_path):
        with pytest.raises(OSError, match=str(path)):
            checksum_of(path)
