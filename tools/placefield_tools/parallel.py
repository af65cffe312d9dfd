"""Work on frames, on all cores."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from placefield.features.frames import Frame

Result = TypeVar("Result")


def map_in_order(function: Callable[[Frame], Result], frames: Iterable[Frame]) -> Iterator[Result]:
    """Apply a function to frames, a few ahead, and yield the results in order."""
    workers = os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        ahead: deque[Future[Result]] = deque()
        for frame in frames:
            ahead.append(pool.submit(function, frame))
            if len(ahead) > 2 * workers:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
