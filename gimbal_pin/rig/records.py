"""Dataclasses from a file's plain values: every key known, every value of its field's kind and within its bounds.

A field's annotation is the kind of its value, and ``bounded_field`` states the range of a number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from gimbal_pin.errors import GimbalPinError
from gimbal_pin.rig.reading import parse_decimal

_T = TypeVar("_T")
LARGEST_NUMBER = 1e16
"""Size of numbers where a field states no bounds: it is SDF's for no limit, and its products are finite."""
Bounds = tuple[float, float]
_ANY: Bounds = (-LARGEST_NUMBER, LARGEST_NUMBER)


def bounded_field(default: Any, lower: float, upper: float) -> Any:
    """Return a dataclass's field whose number, if a file states it, lies within bounds."""
    return field(default=default, metadata={"bounds": (lower, upper)})


@contextmanager
def prefix_place(place: str, error: type[GimbalPinError]) -> Iterator[None]:
    """Turn an error of the package inside the block into an `error` that names the file, too."""
    try:
        yield
    except GimbalPinError as refusal:
        where = refusal.place if refusal.place.startswith(place) else f"{place}: {refusal.place}"
        raise error(where, refusal.what, refusal.mend) from refusal


@cache
def _list_fields(kind: Any) -> Mapping[str, tuple[Any, Bounds, bool]]:
    """Return field → its annotation, its bounds, and whether it is required."""
    hints = get_type_hints(kind)
    rows = (
        (own, own.default is MISSING and own.default_factory is MISSING) for own in fields(kind)
    )
    return {
        own.name: (hints[own.name], own.metadata.get("bounds", _ANY), needed)
        for own, needed in rows
    }


def read_record(
    kind: Callable[..., _T],
    data: Any,
    place: str,
    error: type[GimbalPinError],
    others: bool = False,
) -> _T:
    """Return a dataclass from a table; an `error` names what is missing, unknown or of the wrong kind.

    `others`: whether the table may have keys that are not its fields, which are ignored.
    """
    values = read_fields(kind, data, place, error, others)
    if missing := [
        name for name, (*_, needed) in _list_fields(kind).items() if needed and name not in values
    ]:
        raise error(place, f"has no {', '.join(missing)}", "give it")
    return kind(**values)


def read_fields(
    kind: Any, data: Any, place: str, error: type[GimbalPinError], others: bool = False
) -> dict[str, Any]:
    """Return the values of the fields of a dataclass that a table states."""
    known = _list_fields(kind)
    if not isinstance(data, dict):
        raise error(
            place, "is not a table of keys and values", f"give keys out of {', '.join(known)}"
        )
    if unknown := [key for key in data if key not in known and not others]:
        raise error(
            place, f"has an unknown key '{unknown[0]}'", f"the known ones are {', '.join(known)}"
        )
    rows = ((key, form, bounds) for key, (form, bounds, _) in known.items() if key in data)
    return {
        key: convert_value(form, data[key], _join_place(place, key), error, bounds)
        for key, form, bounds in rows
    }


def convert_value(
    kind: Any, x: Any, place: str, error: type[GimbalPinError], bounds: Bounds = _ANY
) -> Any:
    """Return a plain value converted to its annotation."""
    form = get_origin(kind)
    inner = get_args(kind)
    if kind is Any:
        return x
    if form in (Union, UnionType):
        if x is None and NoneType in inner:
            return None
        several = [each for each in inner if each is not NoneType]
        fitting = [
            each
            for each in several
            if (get_origin(each) is not None) == isinstance(x, (dict, list))
        ]
        return convert_value((fitting or several)[0], x, place, error, bounds)
    if isinstance(kind, type) and is_dataclass(kind):
        return read_record(kind, x, place, error)
    if kind in (float, int):
        return _convert_number(kind, x, place, error, bounds)
    shape, words = _YAML_FORMS[form or kind]
    if not isinstance(x, shape):
        raise error(place, f"is {x!r}", f"write {words}")
    if isinstance(x, dict):
        return {
            key: convert_value(inner[1], each, _join_place(place, key), error, bounds)
            for key, each in x.items()
        }
    if isinstance(x, list):
        return tuple(
            convert_value(inner[0], each, f"{place}[{k}]", error, bounds)
            for k, each in enumerate(x)
        )
    return x


def _join_place(place: str, key: str) -> str:
    """``rig.yaml: motors.yaw``: the place of an entry."""
    return f"{place}.{key}" if ": " in place else f"{place}: {key}"


_YAML_FORMS: Mapping[Any, tuple[type, str]] = {
    str: (str, "a text"),
    bool: (bool, "true or false"),
    tuple: (list, "a list"),
    Mapping: (dict, "a table of names and values"),
}
"""Annotation → what YAML makes of it, in words, too."""


def _convert_number(
    kind: type, x: Any, place: str, error: type[GimbalPinError], bounds: Bounds
) -> float:
    """Return a number within bounds, whole where `kind` is int; ``1e-3``, which YAML 1.1 takes for a text, is one."""
    read = parse_decimal(x) if isinstance(x, str) else None if isinstance(x, bool) else x
    if not isinstance(read, (int, float)):
        raise error(place, f"is {x!r}, which is no number", "write a number, in SI units")
    lower, upper = bounds
    if not lower <= read <= upper:
        raise error(place, f"is {read:g}", f"give {lower:g} to {upper:g}, in SI units")
    if kind is int and read % 1:
        raise error(place, f"is {read:g}", "write a whole number")
    return kind(read)
