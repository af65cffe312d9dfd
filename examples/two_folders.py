"""Recognise the frames of one folder among those of another, with no service and no bus.

    python examples/two_folders.py demo/day demo/dusk

It prints a line for each frame of the second folder: its name, the place, which is the number of a
frame of the first folder, and the probability that this is right.
"""

import sys
from pathlib import Path

from placefield import Recognizer, build_map


def main(reference: str, query: str) -> None:
    """Build a map of the first folder, and smooth the matches of the second."""
    recognizer = Recognizer(build_map(sorted(Path(reference).glob("*.jpg"))))
    files = sorted(Path(query).glob("*.jpg"))
    for file in files:
        recognizer.update(file)  # this gives a match at once; smoothed ones are right more often
    for smoothed in recognizer.finish():
        match = smoothed.match
        print(files[smoothed.frame].name, match.place, f"{match.probability:.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
