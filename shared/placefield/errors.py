"""The known errors of Placefield.

A known error is one line for a person: it names the file, key or flag and what to do. The command
line prints it on stderr and exits with 1. Any other exception is a defect and keeps its traceback.
"""


class PlacefieldError(Exception):
    """Root of all known errors."""


class ConfigError(PlacefieldError):
    """A setting is unknown, malformed or does not fit the others."""


class SourceError(PlacefieldError):
    """A source of frames is missing, empty or unreadable."""


class FrameError(PlacefieldError):
    """One frame cannot be made into an image."""


class MapError(PlacefieldError):
    """A map cannot be built, written, or read."""


class TruthError(PlacefieldError):
    """A ground truth is malformed or does not fit the query."""


class MessageError(PlacefieldError):
    """A message on the bus does not parse."""


class OtherMapError(MessageError):
    """A message on the bus is about another map than this process uses."""


class BusError(PlacefieldError):
    """The bus cannot be opened, or a service on it is missing."""
