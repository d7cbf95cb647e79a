"""Causes from plain data, as JSON and YAML hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gimbal_pin.effects import CAUSES, PLAIN, Cause, Effect, Term
from gimbal_pin.effects.torque_table import TorqueTable
from gimbal_pin.errors import ModelError
from gimbal_pin.rig.records import convert_value, prefix_place, read_record


def read_cause(data: Any) -> Cause:
    """Return the cause that `Cause.to_dict` wrote.

    Raises:
        ModelError: An unknown cause, a field that it does not have or that is missing, or a value that it cannot have.
    """
    kinds: tuple[type[Effect], ...] = (*PLAIN, TorqueTable)
    every: Mapping[str, type[Cause]] = {**CAUSES, **{kind.name: kind for kind in kinds}}
    if not isinstance(data, dict):
        raise ModelError("effect", "is no table of a cause and its values", "write it with to_dict")
    name = data.get("effect")
    if not isinstance(name, str) or name not in every:
        raise ModelError(
            "effect", f"{name!r} is unknown", f"the known ones are {', '.join(sorted(every))}"
        )
    with prefix_place(f"effect {name}", ModelError):
        held = {key: x for key, x in data.items() if key not in ("effect", "values")}
        return read_record(every[name], held, f"effect {name}", ModelError)


def read_term(data: Any) -> Term:
    """Return the term that `Term.to_dict` wrote.

    Raises:
        ModelError: It is no torque effect, or has another number of values than coefficients.
    """
    effect = read_cause(data)
    place = f"effect {data['effect']}"
    if not isinstance(effect, Effect):
        raise ModelError(place, "is no term: it acts on no torque", "write it with to_dict")
    values = convert_value(tuple[float, ...], data.get("values"), f"{place}: values", ModelError)
    if len(values) != len(effect.coefficients):
        raise ModelError(
            place, "is no term with one value per coefficient", "write it with to_dict"
        )
    return Term(effect, values)
