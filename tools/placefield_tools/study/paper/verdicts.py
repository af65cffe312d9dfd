"""The paper's two claims, put to the results: AMS beats MS, and gains from more channels."""

from placefield_tools.study.paper.paper_results import CountResult, FeatureResult

_EQUAL = 0.01  # AUC
_PLATEAU = 8  # channels, beyond which the paper gains no more


def of_methods(result: FeatureResult) -> str | None:
    """Say whether AMS beats MS in AUC, on many scales and on one; None where MS did not run."""
    parts = []
    for scales in ("many", "one"):
        fixed, adaptive = result.line("MS", scales), result.line("AMS", scales)
        if fixed is None or adaptive is None:
            return None
        word = compared(adaptive.judged.curve.auc, fixed.judged.curve.auc)
        figures = f"{adaptive.judged.curve.auc:.3f} against {fixed.judged.curve.auc:.3f}"
        parts.append(f"on {scales} scale{'s' * (scales == 'many')} it {word} MS ({figures})")
    return f"AMS, {result.feature}: {parts[0]}; {parts[1]}"


def of_channels(result: FeatureResult) -> str | None:
    """Say what mean AUC becomes with more channels; None where they were not combined."""
    if not result.counts:
        return None
    one, eight, ten = (_mean_auc(result.counts, n) for n in (1, _PLATEAU, len(result.counts)))
    return (
        f"AMS, {result.feature}: mean AUC of one channel {one:.3f}, of {_PLATEAU} {eight:.3f}, of "
        f"{len(result.counts)} {ten:.3f}: more channels {_gained(eight - one)}"
    )


def compared(auc: float, other: float) -> str:
    """Say whether an AUC is better than another, by more than .01."""
    if abs(auc - other) <= _EQUAL:
        return "equals"
    return "beats" if auc > other else "loses to"


def _gained(difference: float) -> str:
    if abs(difference) <= _EQUAL:
        return "change next to nothing"
    return "help" if difference > 0 else "harm"


def _mean_auc(counts: tuple[CountResult, ...], channels: int) -> float:
    return next(float(count.auc.mean()) for count in counts if count.channels == channels)
