"""The frame in a message of a source."""

from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage
from placefield.features.frames import Frame


def frame_of(header: Header, message: FrameMessage) -> Frame:
    """Return the frame of a message, with its header's number and stamp."""
    return Frame(
        header.sequence,
        header.stamp_ns,
        f"frame {header.sequence}",
        b"" if message.image is None else message.image,
        descriptor=message.descriptor,
        calibration=message.calibration,
    )
