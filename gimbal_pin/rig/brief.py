"""How results print at a prompt: what they are and what they hold, in a few lines at most."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from gimbal_pin.errors import FEW, digits, shortened, visible

_LONGEST = 400
"""Most characters of a `repr`: five lines of a terminal of eighty columns."""
_LONGEST_WORD = 60
"""Most characters of a text in it."""


def brief(result: Any) -> str:
    """Return the first lines of ``str``, or ``Type(field=what it holds, …)``: a class takes it as its ``__repr__``.

    Of an array it is the shape, of names the names, of other things how many there are. What is None or empty is left
    out, and so is what would be beyond `_LONGEST`.
    """
    if "__str__" in vars(type(result)):
        return _join_fitting(str(result).split("\n"))
    names = [one.name for one in fields(result)] if is_dataclass(result) else result._fields
    values = ((name, getattr(result, name)) for name in names)
    shown = [f"{name}={_describe_value(value)}" for name, value in values if not _is_empty(value)]
    name = type(result).__name__
    return f"{name}({_join_fitting(shown, ', ', _LONGEST - len(name) - 2)})"


def _join_fitting(parts: Sequence[str], between: str = "\n", most: int = _LONGEST) -> str:
    """Join as many of the first parts as fit into so many characters; the first is shortened if need be."""
    text = between.join(parts)
    if len(text) <= most:
        return text
    cut = text.rfind(between, 0, most - len(between))
    return shortened(parts[0], most) if cut < 0 else f"{text[:cut]}{between}…"


def _is_empty(value: Any) -> bool:
    """Whether a field holds nothing."""
    return value is None or (isinstance(value, (str, tuple, list, Mapping)) and not value)


def _describe_value(value: Any) -> str:
    """Return in a few words what a field holds."""
    if isinstance(value, str):
        return repr(shortened(visible(value), _LONGEST_WORD))
    if isinstance(value, (bool, int)):
        return str(value)
    if isinstance(value, float):
        return digits(value)
    if shape := getattr(value, "shape", ()):
        return f"{' × '.join(map(str, shape))} array"
    if isinstance(value, Mapping):
        return f"{{{', '.join(_list_first([str(key) for key in value]))}}}"
    if hasattr(value, "_fields"):
        return type(value).__name__
    if isinstance(value, (tuple, list)) and isinstance(value[0], (str, bool, int, float)):
        return f"({', '.join(_list_first([_describe_value(one) for one in value]))})"
    if isinstance(value, (tuple, list)):
        return f"{len(value)} {type(value[0]).__name__}"
    return type(value).__name__


def _list_first(names: list[str]) -> Iterator[str]:
    """Yield the first few names, and how many more there are."""
    yield from (shortened(name, _LONGEST_WORD) for name in names[:FEW])
    if len(names) > FEW:
        yield f"{len(names) - FEW} more"
