import re
from xml.etree import ElementTree as ET

from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.digest import NO_DIGEST
from placefield_tools.dashboard.certainty_drawing import (
    HEIGHT,
    Drawn,
    certainty_drawing,
    score_range,
)

_OF_MAP = {"map": NO_DIGEST, "place": 1}


def points(frames: list[Drawn]) -> dict[str | None, list[tuple[float, float]]]:
    """The points of each line, from 0 at the bottom to 1 at the top of the probabilities."""
    inside = ET.fromstring(f"<svg>{certainty_drawing(frames, 200, 0.99)}</svg>")
    numbers = {
        path.get("class"): re.findall(r"(?<=[ML])([\d.]+) ([\d.]+)", path.get("d", ""))
        for path in inside
    }
    low, high = HEIGHT - 3, 3
    return {
        kind: [(float(x), round((float(y) - low) / (high - low), 2)) for x, y in found]
        for kind, found in numbers.items()
    }


def test_certainty_shows_both_answers_the_score_and_the_threshold() -> None:
    frames: list[Drawn] = [
        (0, MatchMessage(**_OF_MAP, score=-1.0, probability=0.25, known=False), None),
        (
            1,
            MatchMessage(**_OF_MAP, score=2.0, probability=0.9, known=True),
            SmoothedMessage(**_OF_MAP, score=3.0, probability=1.0, known=True, lag=4),
        ),
        (2, MatchMessage(**_OF_MAP, score=3.0), None),
    ]
    assert points(frames) == {
        "asked": [(0.0, 0.99)],
        "score": [(0.5, 0.0), (1.5, 0.75), (2.5, 1.0)],
        "smoothed": [(1.5, 1.0)],
        "at-once": [(0.5, 0.25), (1.5, 0.9)],
        "unknown under": [(0.5, 0.25)],
        "unknown over": [(0.5, 0.25)],
    }
    assert score_range(frames) == (-1.0, 3.0)


def test_equal_scores_and_no_frames_are_drawn() -> None:
    frames: list[Drawn] = [(0, MatchMessage(**_OF_MAP, score=2.0), None)]
    assert points(frames)["score"] == [(0.5, 0.0)]
    assert set(points([])) == {"asked"}
    assert score_range([]) is None
