"""What to use on the route of a study, and how far one may trust it, in words."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from placefield_tools.common.natural_sort import counted
from placefield_tools.evaluate.judging import Judged
from placefield_tools.study.results import MethodResult, Study


@dataclass(frozen=True)
class Use:
    """The best method for a need.

    Attributes:
        need: in words.
        method: name of the method.
        judged: its matches.
    """

    need: str
    method: str
    judged: Judged


def uses(study: Study) -> list[Use]:
    """Return the best method for each need, of those that did not fail and are no oracle."""
    at_once = _fair(study, lambda method: method.lag == 0)
    needs = (
        ("an answer at once, none wrong", at_once, _recall_without_error),
        ("none wrong, and the answer may come later", _fair(study, _any), _recall_without_error),
        ("most frames right, some wrong", _fair(study, _any), _recall),
    )
    bests = ((need, _best(methods, figure)) for need, methods, figure in needs)
    return [Use(need, best[0].name, best[1]) for need, best in bests if best is not None]


def verdict(study: Study) -> list[str]:
    """Say in at most three sentences what the study comes to."""
    ours = _best(_fair(study, lambda method: method.ours), _recall_without_error)
    others = _best(_fair(study, lambda method: not method.ours), _recall_without_error)
    sentences = []
    if ours is not None:
        method, judged = ours
        sentences.append(
            f"{method.name} recognises {judged.curve.recall_at_100_precision:.0%} of the route's "
            "frames without a wrong match, by the best threshold."
        )
    if others is not None:
        method, judged = others
        recall = judged.curve.recall_at_100_precision
        sentences.append(f"The best of the other methods, {method.name}, recognises {recall:.0%}.")
    return [*sentences, *_trust(study)]


def _trust(study: Study) -> list[str]:
    """Say what the matches that are called known come to, of the method that calls the most so."""
    rated = [(method, judged) for method, judged in _fair(study, _any) if judged.claims is not None]
    if not rated:
        return []
    method, judged = max(rated, key=lambda one: one[1].claims.recall if one[1].claims else 0.0)
    claims = judged.claims
    assert claims is not None
    wrong = claims.count - round(claims.precision * claims.count)
    right = f"{wrong} of them wrongly" if wrong else "all rightly"
    frames = counted(claims.count, "frame")
    return [f"At the precision asked for, {method.name} calls {frames} known, {right}."]


_Judged = tuple[MethodResult, Judged]
_Figure = Callable[[Judged], tuple[float, float]]


def _fair(study: Study, wanted: Callable[[MethodResult], bool]) -> list[_Judged]:
    return [
        (method, method.judged)
        for method in study.methods
        if method.judged is not None and not method.oracle and wanted(method)
    ]


def _any(method: MethodResult) -> bool:
    return True


def _best(methods: Sequence[_Judged], figure: _Figure) -> _Judged | None:
    return max(methods, key=lambda one: figure(one[1]), default=None)


def _recall_without_error(judged: Judged) -> tuple[float, float]:
    return judged.curve.recall_at_100_precision, judged.curve.auc


def _recall(judged: Judged) -> tuple[float, float]:
    return judged.curve.recall_at_1, judged.curve.auc
