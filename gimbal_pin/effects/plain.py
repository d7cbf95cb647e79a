"""Causes from plain data, as JSON and YAML hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gimbal_pin.effects import ALWAYS, CAUSES, Cause, Effect, Term
from gimbal_pin.errors import ModelError


def cause_from(data: Mapping[str, Any]) -> Cause:
    """Return the cause that `Cause.to_dict` wrote.

    Raises:
        ModelError: An unknown cause, or a field that it does not have or that is missing.
    """
    kinds = {**CAUSES, **{kind.name: kind for kind in ALWAYS}}
    name = data.get("effect")
    if name not in kinds:
        raise ModelError("effect", f"'{name}' is unknown", f"the known ones are {', '.join(sorted(kinds))}")
    held = {key: tuple(x) if isinstance(x, list) else x for key, x in data.items() if key not in ("effect", "values")}
    try:
        return kinds[name](**held)
    except TypeError as error:
        raise ModelError(f"effect {name}", f"cannot be read ({error})", "write it with to_dict") from error


def term_from(data: Mapping[str, Any]) -> Term:
    """Return the term that `Term.to_dict` wrote.

    Raises:
        ModelError: It is no torque effect, or has another number of values than coefficients.
    """
    effect, values = cause_from(data), data.get("values")
    if not isinstance(effect, Effect) or not isinstance(values, list) or len(values) != len(effect.coefficients):
        raise ModelError(f"effect {effect.name}", "is no term with one value per coefficient", "write it with to_dict")
    return Term(effect, tuple(float(value) for value in values))
