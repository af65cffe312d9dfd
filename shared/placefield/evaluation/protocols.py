"""Protocols that resample a query, as if the vehicle had driven in another way.

Routes recorded frame by frame at the same places flatter a matcher that expects the reference's
speed. The protocols measure matching when the vehicle drives unevenly or at another frame rate, is
kidnapped, leaves the route, or drives it in reverse.

A camera that moves slowly gives new frames in between; it never gives one frame twice. So a
traverse that is slower than the reference needs a reference with fewer places than the query has
frames: `speed` and `dense` thin the reference to every n-th frame. Only a stationary vehicle
observes the same view again, and even then the image differs: the frames of a stop are marked as
repeated, so that a source can add the sensor's noise.

`odometry` is the same traverse as `speed`, and gives each frame the reading of an inexact odometer.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Protocol = Literal[
    "aligned", "speed", "odometry", "dense", "sparse", "kidnap", "off-route", "reverse"
]

TAKES_EVERY: tuple[Protocol, ...] = ("speed", "odometry", "dense", "sparse")
"""Protocols that use only every n-th frame of the reference or of the query."""

THINS_REFERENCE: tuple[Protocol, ...] = ("speed", "odometry", "dense")
"""Protocols that use only every n-th frame of the reference."""

DEFAULT_EVERY = 3
SPEED_EVERY = 4
SHORT_SPEED_EVERY = 2
SHORT_REFERENCE = 400
"""For `speed`, a reference with fewer frames is thinned to every ``SHORT_SPEED_EVERY``-th."""

ODOMETRY_ERROR = 0.05
"""Relative deviation of the simulated odometer's scale, and of each of its steps."""


@dataclass(frozen=True, slots=True, eq=False)
class Resampling:
    """The frames of a resampled traverse, in order.

    Attributes:
        frames: (D,) int64, each a frame of the query, or of the other route where `foreign`.
        foreign: (D,) bool, whether the frame is one of another route.
        repeated: (D,) bool, whether the vehicle is stationary: the frame repeats the one before.
        every: only every so many-th frame of the reference is a place; 1 is all of them.
        jumps: (J,) int64, ascending; the positions in the traverse of the first frame after a jump.
        odometry: (D,) float64, metres by a simulated odometer, not descending; None: there is none.
    """

    frames: NDArray[np.int64]
    foreign: NDArray[np.bool_]
    repeated: NDArray[np.bool_]
    jumps: NDArray[np.int64]
    every: int = 1
    odometry: NDArray[np.float64] | None = None


def default_every(protocol: Protocol, references: int) -> int:
    """Return the default n of a protocol that uses every n-th frame.

    Args:
        protocol: one of ``TAKES_EVERY``.
        references: frames of the reference.
    """
    if protocol not in ("speed", "odometry"):
        return DEFAULT_EVERY
    return SHORT_SPEED_EVERY if references < SHORT_REFERENCE else SPEED_EVERY


def drive_of(
    protocol: Protocol, count: int, *, foreign_count: int, seed: int, every: int = DEFAULT_EVERY
) -> Resampling:
    """Resample a query by a protocol.

    Args:
        protocol: the protocol.
        count: number of the query's frames, 1 or more.
        foreign_count: number of the other route's frames; only `off-route` uses any.
        seed: of the protocol's random choices: the same seed gives the same traverse.
        every: n of the protocols of ``TAKES_EVERY``, 1 or more; the others ignore it.

    Raises:
        ValueError: the query has no frames, n is below 1, or `off-route` has no frames of another
            route.
    """
    if count < 1:
        raise ValueError("the query has no frames to drive along")
    if every < 1:
        raise ValueError(f"every {every}: take every frame, 1, or fewer")
    match protocol:
        case "aligned":
            return aligned(count)
        case "speed":
            return speed(count, every, seed)
        case "odometry":
            return odometry(count, every, seed)
        case "dense":
            return dense(count, every)
        case "sparse":
            return sparse(count, every)
        case "kidnap":
            return kidnap(count, seed)
        case "off-route":
            return off_route(count, foreign_count, seed)
        case "reverse":
            return reverse(count)


def aligned(count: int) -> Resampling:
    """Use each of the query's `count` frames once, in order."""
    return _on_route(np.arange(count, dtype=np.int64))


def speed(count: int, every: int, seed: int) -> Resampling:
    """Drive at a speed that changes, with stops, along every n-th frame of the reference.

    Every 10 to 40 frames the step is drawn anew, log-uniformly from 1 to 2 n frames of the query:
    from 1 / n of a place to 2 places, if query and reference were recorded alike. Steps add up as
    real numbers, and each frame is the nearest one of the query, which is a new one at every step.
    Before three in ten of these stretches the vehicle stops for 1 to 8 frames, which repeat the
    frame before. The traverse ends with the query.
    """
    rng = np.random.default_rng(seed)
    stretches = [np.zeros(1)]
    stops = [np.zeros(1, np.bool_)]
    position = 0.0
    while position < count:
        stop = rng.integers(1, 8, endpoint=True) if rng.random() < 0.3 else 0
        step = float((2 * every) ** rng.uniform(0, 1))
        steps = np.full(rng.integers(10, 40, endpoint=True), step)
        stretches += [np.zeros(stop), steps]
        stops += [np.ones(stop, np.bool_), np.zeros(len(steps), np.bool_)]
        position += steps.sum()
    # Halves round up: rounded to the even number, 1.5 and 2.5 would be one frame.
    nearest = np.floor(np.cumsum(np.concatenate(stretches)) + 0.5).astype(np.int64)
    in_query = nearest < count
    return replace(
        _on_route(nearest[in_query]), repeated=np.concatenate(stops)[in_query], every=every
    )


def odometry(count: int, every: int, seed: int) -> Resampling:
    """Drive exactly as `speed` does with the same seed, with the readings of an odometer.

    From place to place of the reference it is 1 m. The odometer has an error of scale, which is
    drawn once, and an error of each step. Both are normally distributed with a relative deviation
    of ``ODOMETRY_ERROR``. The readings never descend.
    """
    drive = speed(count, every, seed)
    rng = np.random.default_rng([seed, 1])  # not the draws of the drive itself
    scale = 1 + ODOMETRY_ERROR * rng.standard_normal()
    of_steps = 1 + ODOMETRY_ERROR * rng.standard_normal(len(drive.frames))
    steps = np.diff(drive.frames, prepend=drive.frames[:1]) / every
    return replace(drive, odometry=np.cumsum(np.maximum(scale * of_steps * steps, 0)))


def dense(count: int, every: int) -> Resampling:
    """Use all of the query's `count` frames along every n-th frame of the reference."""
    return replace(aligned(count), every=every)


def sparse(count: int, every: int) -> Resampling:
    """Use every n-th of the query's `count` frames, along all of the reference's."""
    return _on_route(np.arange(0, count, every, dtype=np.int64))


def kidnap(count: int, seed: int) -> Resampling:
    """Drive 60 to 120 frames, jump to a place drawn uniformly from the route, and so on.

    A leg also ends at the end of the route. No jump goes to the route's last 29 frames, and the
    traverse ends when fewer than 30 frames are left of the query's number, so that at least 30
    follow each jump. For a query below 180 frames these lengths shrink in proportion, so that there
    is at least one jump from 3 frames on.
    """
    rng = np.random.default_rng(seed)
    shortest, longest, reserve = (
        int(np.ceil(length * min(1, count / 180))) for length in (60, 120, 30)
    )
    legs: list[NDArray[np.int64]] = []
    start, left = 0, count
    while left >= reserve > 0:
        length = min(int(rng.integers(shortest, longest, endpoint=True)), count - start, left)
        legs.append(np.arange(start, start + length))
        left -= length
        start = int(rng.integers(0, count - reserve, endpoint=True))
    jumps = np.cumsum([len(leg) for leg in legs[:-1]], dtype=np.int64)
    return _on_route(np.concatenate(legs), jumps)


def off_route(count: int, foreign_count: int, seed: int) -> Resampling:
    """Leave the route for stretches of another one, a third of the traverse in all.

    Each stretch has 30 to 90 frames, unless there is only one. The first begins at a frame of the
    other route that is drawn uniformly; each later one goes on where the one before it ended; the
    end of the other route wraps around to its beginning. After a stretch, the query goes on with
    the frame at which it was left.

    Raises:
        ValueError: the other route has no frames.
    """
    if foreign_count < 1:
        raise ValueError("the other route has no frames to leave the route for")
    rng = np.random.default_rng(seed)
    lengths = _stretches(count // 2, rng)
    # One stretch per equal part of the query, near its middle, so that stretches do not touch.
    leaves = (np.arange(len(lengths)) + rng.uniform(0.25, 0.75, len(lengths))) * count
    at = np.rint(leaves / len(lengths)).astype(np.int64)

    foreign = np.insert(np.zeros(count, np.bool_), np.repeat(at, lengths), True)
    frames = np.empty(len(foreign), np.int64)
    frames[~foreign] = np.arange(count)
    start = rng.integers(foreign_count)
    frames[foreign] = (start + np.arange(sum(lengths))) % foreign_count
    return replace(_on_route(frames), foreign=foreign)


def reverse(count: int) -> Resampling:
    """Use each of the query's `count` frames once, the last one first."""
    return _on_route(np.arange(count, dtype=np.int64)[::-1])


def frames_to_recover(jumps: NDArray[np.int64], correct: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Count the frames from each jump to the first right match after it.

    It is 0 if the first frame after the jump is matched right. If no match is right before the next
    jump or the end, it is the number of frames until then.

    Args:
        jumps: see `Resampling`, (J,) int64.
        correct: whether each frame of the traverse is matched right, (D,) bool.

    Returns:
        (J,) int64.
    """
    legs = np.split(correct, jumps)[1:]
    return np.array([int(leg.argmax()) if leg.any() else len(leg) for leg in legs], np.int64)


def _on_route(frames: NDArray[np.int64], jumps: NDArray[np.int64] | None = None) -> Resampling:
    none = np.zeros(len(frames), np.bool_)
    return Resampling(frames, none, none, np.empty(0, np.int64) if jumps is None else jumps)


def _stretches(total: int, rng: np.random.Generator) -> list[int]:
    """Cut a total at random into lengths from 30 to 90; a smaller total stays whole."""
    lengths = []
    while total > 90:
        lengths.append(int(rng.integers(30, min(90, total - 30), endpoint=True)))
        total -= lengths[-1]
    return [*lengths, total]
