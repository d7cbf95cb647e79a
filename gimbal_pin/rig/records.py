"""Dataclasses from a file's plain values: every key known, every value of its field's kind and within its bounds.

A field's annotation is the kind of its value, and ``bounded`` states the range of a number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from gimbal_pin.errors import GimbalPinError
from gimbal_pin.rig.reading import decimal

T = TypeVar("T")
LARGEST = 1e16
"""Size of numbers where a field states no bounds: it is SDF's for no limit, and its products are finite."""


def bounded(default: Any, lower: float, upper: float) -> Any:
    """Return a dataclass's field whose number, if a file states it, lies within bounds."""
    return field(default=default, metadata={"bounds": (lower, upper)})


@contextmanager
def placed(place: str, error: type[GimbalPinError]) -> Iterator[None]:
    """Turn an error of the package inside the block into an `error` that names the file, too."""
    try:
        yield
    except GimbalPinError as refusal:
        where = refusal.place if refusal.place.startswith(place) else f"{place}: {refusal.place}"
        raise error(where, refusal.what, refusal.mend) from refusal


@cache
def form_of(kind: Any) -> Mapping[str, tuple[Any, float, float, bool]]:
    """Return field → its annotation, its bounds, and whether it is required."""
    hints = get_type_hints(kind)
    return {
        own.name: (
            hints[own.name],
            *own.metadata.get("bounds", (-LARGEST, LARGEST)),
            own.default is MISSING and own.default_factory is MISSING,
        )
        for own in fields(kind)
    }


def record(kind: Callable[..., T], data: Any, place: str, error: type[GimbalPinError], others: bool = False) -> T:
    """Return a dataclass from a table; an `error` names what is missing, unknown or of the wrong kind.

    `others`: whether the table may have keys that are not its fields, which are ignored.
    """
    values = stated(kind, data, place, error, others)
    if missing := [name for name, (*_, needed) in form_of(kind).items() if needed and name not in values]:
        raise error(place, f"has no {', '.join(missing)}", "give it")
    return kind(**values)


def stated(kind: Any, data: Any, place: str, error: type[GimbalPinError], others: bool = False) -> dict[str, Any]:
    """Return the values of the fields of a dataclass that a table states."""
    known = form_of(kind)
    if not isinstance(data, dict):
        raise error(place, "is not a table of keys and values", f"give keys out of {', '.join(known)}")
    if unknown := [key for key in data if key not in known and not others]:
        raise error(place, f"has an unknown key '{unknown[0]}'", f"the known ones are {', '.join(known)}")
    rows = [(key, form, low, high) for key, (form, low, high, _) in known.items() if key in data]
    return {key: value(form, data[key], inside(place, key), error, low, high) for key, form, low, high in rows}


def value(
    kind: Any, x: Any, place: str, error: type[GimbalPinError], lower: float = -LARGEST, upper: float = LARGEST
) -> Any:
    """Return a plain value converted to its annotation."""
    form, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return x
    if form in (Union, UnionType):
        if x is None and NoneType in inner:
            return None
        several = [each for each in inner if each is not NoneType]
        fitting = [each for each in several if (get_origin(each) is not None) == isinstance(x, (dict, list))]
        return value((fitting or several)[0], x, place, error, lower, upper)
    if isinstance(kind, type) and is_dataclass(kind):
        return record(kind, x, place, error)
    if kind in (float, int):
        return number(kind, x, place, error, lower, upper)
    shape, words = FORMS[form or kind]
    if not isinstance(x, shape):
        raise error(place, f"is {x!r}", f"write {words}")
    if isinstance(x, dict):
        return {key: value(inner[1], each, inside(place, key), error, lower, upper) for key, each in x.items()}
    if isinstance(x, list):
        return tuple(value(inner[0], each, f"{place}[{k}]", error, lower, upper) for k, each in enumerate(x))
    return x


def inside(place: str, key: str) -> str:
    """``rig.yaml: motors.yaw``: the place of an entry."""
    return f"{place}.{key}" if ": " in place else f"{place}: {key}"


FORMS: Mapping[Any, tuple[type, str]] = {
    str: (str, "a text"),
    bool: (bool, "true or false"),
    tuple: (list, "a list"),
    Mapping: (dict, "a table of names and values"),
}
"""Annotation → what YAML makes of it, in words, too."""


def number(kind: type, x: Any, place: str, error: type[GimbalPinError], lower: float, upper: float) -> float:
    """Return a number within bounds, whole where `kind` is int; ``1e-3``, which YAML 1.1 takes for a text, is one."""
    read = decimal(x) if isinstance(x, str) else None if isinstance(x, bool) else x
    if not isinstance(read, (int, float)):
        raise error(place, f"is {x!r}, which is no number", "write a number, in SI units")
    if not lower <= read <= upper:
        raise error(place, f"is {read:g}", f"give {lower:g} to {upper:g}, in SI units")
    if kind is int and read % 1:
        raise error(place, f"is {read:g}", "write a whole number")
    return kind(read)
