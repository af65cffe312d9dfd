"""The fraction of LMNN's push term, as the setting ``metric.push`` gives it."""

from typing import Annotated

from pydantic import AfterValidator
from pydantic_core import PydanticCustomError

_CROSS_VALIDATION = "cross-validation"


def _check_push(push: float | str) -> float | str:
    if push == _CROSS_VALIDATION:
        return push
    try:
        fraction = float(push)
    except ValueError:
        fraction = -1
    if not 0 <= fraction <= 1:
        raise PydanticCustomError("push", f"give a fraction from 0 to 1, or {_CROSS_VALIDATION}")
    return fraction


Push = Annotated[float | str, AfterValidator(_check_push)]
"""A fraction, 0 to 1, or text that lets cross-validation choose it."""
