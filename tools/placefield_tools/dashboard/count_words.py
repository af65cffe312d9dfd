"""What the services count, in plain words, for the page: the bus has the exact definitions."""

from collections.abc import Collection

MEANINGS = {
    "received": "messages that the service has read",
    "matches": "frames answered",
    "smoothed": "frames that were matched again with later frames",
    "partial": "frames answered without the answers of all channels",
    "too_fast": "frames between which the vehicle passes more places than the map resolves",
    "streams": "sequences of frames that the service has followed, such as replays",
    "gaps": "frames that the service skipped, or that did not reach it",
    "repeated": "frames that were sent again",
    "fetched": "answers fetched from other services after a restart",
    "verified": "matches that were checked by the geometry of the two images",
    "unlikely": "matches not checked: they are unlikely already",
    "no_features": "matches not checked: the map has no local features of the place",
    "no_frame": "matches not checked: the frame did not come",
    "no_image": "matches not checked: the frame has no image",
    "kept": "frames kept for the new map",
    "without_image": "frames kept without their image",
    "forgotten": "streams resumed although too little of them was kept",
    "out_of_order": "messages that came too early; they are sent again",
    "late": "answers of channels that came after the frame was answered",
    "duplicate": "second answers, from a replica of a channel",
    "stale": "messages of a stream that is over",
    "described_here": "frames that the featurizer described as no describer did",
    "unreadable": "images that cannot be read",
    "blank": "images of one colour: the lens is covered, or it is dark",
    "unknown_channel": "answers of channels that the map does not have",
    "malformed": "messages that cannot be understood",
    "other_map": "messages of another map",
    "failed": "messages lost to a defect of Placefield; see the log",
    "dropped_full": "messages dropped, as too many waited",
    "dropped_old": "live frames dropped for newer ones",
    "offers": "times that the map was offered to another host",
    "chunks": "pieces of the map that were sent",
    "refused": "requests for pieces that the map does not have",
    "frames": "images handed on",
    "left_out": "frames left out on purpose, as by the spacing",
    "poses": "poses handed to ROS",
    "smoothed_poses": "poses handed to ROS again, with later frames",
}
"""The meaning of each count, by its name."""


def glossary(names: Collection[str]) -> dict[str, str]:
    """Return the meanings of counts, in the order of their names; unknown ones have none."""
    return {name: MEANINGS[name] for name in sorted(names) if name in MEANINGS}
