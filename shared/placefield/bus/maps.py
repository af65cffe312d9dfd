"""Keys and messages to download a map over the bus.

Every map server that has a map of the name answers the query for its manifest. Each server answers
for chunks of files on a key of its own, so that a chunk is sent only once.
"""

import re
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import quote

from pydantic import Field

from placefield.bus.keys import ROOT
from placefield.bus.message import Message
from placefield.errors import MessageError

_CHUNK = re.compile(r"(?P<digest>[0-9a-f]{64})/(?P<file>.{1,1000})/(?P<number>[0-9]{1,12})")


@dataclass(frozen=True)
class MapKeys:
    """The keys of maps of this name, on any host."""

    name: str

    @property
    def _all(self) -> str:
        return f"{ROOT}/maps/{quote(self.name, safe='', errors='surrogateescape')}"

    @property
    def manifest(self) -> str:
        """The manifest; every server that has a map of this name answers."""
        return f"{self._all}/manifest"

    def chunks(self, server: str) -> str:
        """All chunks of one server."""
        return f"{self._all}/{server}/**"

    def chunk(self, server: str, digest: str, file: str, number: int) -> str:
        """A chunk of a file of the map whose manifest has this digest."""
        return f"{self._all}/{server}/{digest}/{file}/{number}"


def chunk_of(key: str) -> tuple[str, str, int]:
    """Read digest, file and number from the key of a chunk.

    Raises:
        MessageError: the key is malformed.
    """
    match = _CHUNK.fullmatch(key.split("/", 4)[-1])
    if match is None:
        raise MessageError(f"{key!r:.200} is not the key of a chunk")
    return match["digest"], match["file"], int(match["number"])


class OfferMessage(Message):
    """The offer of a map, attached to its manifest.

    Attributes:
        server: identity of the map server that sends the chunks.
        sizes: bytes of each file of the map.
    """

    server: str = Field(pattern=r"^[0-9a-f]{1,32}$")
    sizes: dict[str, Annotated[int, Field(ge=1, lt=2**48)]]
