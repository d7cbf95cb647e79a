"""Types of the public functions' arguments, checked against their annotations."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache, wraps
from numbers import Integral, Real
from types import UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from gimbal_pin.errors import UsageError, shortened
from gimbal_pin.rig.types import Array

P = ParamSpec("P")
R = TypeVar("R")
SHOWN_CHARACTERS = 60
"""Length of a wrong argument in an error's text, in characters."""
NAMES: Mapping[str, str] = {
    "float": "a number",
    "int": "a whole number",
    "str": "a string",
    "NoneType": "None",
    "Rig": "a Rig (Rig.load)",
    "Log": "a Log (read_log, bench_run)",
    "Model": "a Model (identify(…).model, diagnose(…).after, nominal)",
    "IdentificationResult": "a fit (identify)",
}
"""Name of a type → how an error's text names it, and what returns one."""


def check_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise `UsageError` for arguments that its signature or its annotations do not allow.

    Lists are checked element by element. Arrays, the values of mappings, and annotations that name types for the type
    checker alone are not checked.
    """
    signature = inspect.signature(function)
    place = function.__qualname__

    @wraps(function)
    def checked(*given: P.args, **named: P.kwargs) -> R:
        try:
            arguments = signature.bind(*given, **named).arguments
        except TypeError as error:
            raise UsageError(
                f"{place}()", str(error), f"its arguments are {', '.join(signature.parameters)}"
            ) from error
        hints = _resolve_annotations(function)
        for name, value in arguments.items():
            if name in hints:
                check_type(f"{place}: {name}", value, hints[name])
        return function(*given, **named)

    return checked


@cache
def _resolve_annotations(function: Callable[..., object]) -> Mapping[str, Any]:
    """Return argument → its annotated type, without those whose types the type checker alone knows."""
    names = inspect.unwrap(function).__globals__
    hints = dict[str, Any]()
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.annotation is not inspect.Parameter.empty:
            with suppress(NameError):
                hints[name] = eval(parameter.annotation, names)
    return hints


def check_type(place: str, value: object, hint: Any) -> None:
    """Raise `UsageError` for a value that is not of an annotated type."""
    if not _matches(value, hint):
        what = f"is {shortened(repr(value), SHOWN_CHARACTERS)}, of type {type(value).__name__}"
        raise UsageError(place, what, f"give {_describe(hint)}")


def to_numbers(place: str, value: object, form: str) -> Array:
    """Return an array of numbers; `UsageError` for anything else, which asks for the shape `form`."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        what = f"is no array of numbers ({error})"
        raise UsageError(place, what, f"give shape {form}") from error


def to_rows(place: str, width: int, given: Mapping[str, object]) -> dict[str, Array]:
    """Return arrays of one shape: (N, width) with a row per sample, or (width,) for one sample.

    Args:
        place: The function, for the error's text.
        width: Number of columns.
        given: Argument → array, or None, which is left out.

    Raises:
        UsageError: One holds no numbers, or is of another shape than the first.
    """
    form = f"({width},) or (N, {width})"
    rows = dict[str, Array]()
    for name, value in given.items():
        if value is None:
            continue
        array = to_numbers(f"{place}: {name}", value, form)
        if not rows and (array.ndim not in (1, 2) or array.shape[-1] != width):
            raise UsageError(f"{place}: {name}", f"has shape {array.shape}", f"give shape {form}")
        first = next(iter(rows.values()), array)
        if array.shape != first.shape:
            what = f"has shape {array.shape}"
            raise UsageError(
                f"{place}: {name}", what, f"give {first.shape} as of {next(iter(rows))}"
            )
        rows[name] = array
    return rows


def check_count(place: str, value: Array, count: int) -> None:
    """Raise `UsageError` if an array does not hold one number for each of so many samples."""
    if value.shape != (count,):
        raise UsageError(place, f"has shape {value.shape}", f"give one per sample, ({count},)")


def _matches(value: object, hint: Any) -> bool:
    """Return whether a value is of an annotated type, as far as the annotation says."""
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin in (Union, UnionType):
        return any(_matches(value, one) for one in inner)
    if origin is Literal:
        return value in inner
    if hint in (float, int):
        return isinstance(value, Real if hint is float else Integral) and not isinstance(
            value, bool
        )
    if origin in (Sequence, Iterable):
        if isinstance(value, (list, tuple)):
            return all(_matches(one, inner[0]) for one in value)
        return isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping))
    if origin is Mapping:
        return isinstance(value, Mapping)
    if getattr(hint, "_is_protocol", False):
        return callable(value) or "__call__" not in vars(hint)
    return not isinstance(hint, type) or isinstance(value, hint)


def _describe(hint: Any) -> str:
    """Return the name of an annotated type in an error's text."""
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(map(_describe, inner))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin in (Sequence, Iterable):
        return f"a list ({_describe(inner[0])})"
    name = getattr(hint, "__name__", str(hint))
    return NAMES.get(name, name)
