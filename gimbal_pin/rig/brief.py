"""How results show themselves: as a line at a prompt, in a notebook, as a table, a figure and a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gimbal_pin.errors import FEW, digits, shortened, visible
from gimbal_pin.rig.arguments import check_arguments

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

_LONGEST = 400
"""Most characters of a `repr`: five lines of a terminal of eighty columns."""
_LONGEST_WORD = 60
"""Most characters of a text in it."""


class Record:
    """What a function of the package returns: a frozen dataclass of numbers, which shows itself.

    How it looks, `report.pages.describe_record` alone knows: it is asked for when a person looks, and is the one
    import of a higher room by a lower.
    """

    ROWS: ClassVar[str]
    """Key of `to_dict`, or several joined by dots, under which the rows of `to_frame` stand: a list, or name → row."""

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds, in SI units and radians."""
        raise NotImplementedError

    def to_frame(self) -> DataFrame:
        """Return its main rows, ``to_dict()[ROWS]``, as a table of Pandas; what is nested has names with dots."""
        import pandas as pd

        rows: Any = reduce(lambda found, key: found[key], self.ROWS.split("."), self.to_dict())
        if isinstance(rows, Mapping):
            rows = [{"name": name, **row} for name, row in rows.items()]
        return pd.json_normalize(rows)

    def plot(self) -> Figure:
        """Return its main figure, the first of its page; `UsageError` where there is nothing to draw."""
        figure: Figure = self._describe().draw()
        return figure

    def animate(self, path: str | Path | None = None) -> Any:
        """Return its motion as a scene that a notebook shows, and write it as the path's suffix says, see `animate`."""
        return self._describe().animate(path)

    @check_arguments
    def report(self, path: str | Path) -> None:
        """Write all that there is to say of it as one page of HTML, which needs nothing but a browser."""
        self._describe().write(path)

    def __str__(self) -> str:
        """Return what a terminal shows."""
        return str(self._describe().to_text())

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the sections that a terminal prints, with their figures."""
        return str(self._describe().to_inline_html())

    def _describe(self) -> Any:
        """Return its page, a `report.Document`."""
        return import_module("gimbal_pin.report.pages").describe_record(self)


def brief(result: Any) -> str:
    """Return the first line of ``str``, or ``Type(field=what it holds, …)``: a class takes it as its ``__repr__``.

    Of an array it is the shape, of names the names, of other things how many there are. What is None or empty is left
    out, and so is what would be beyond `_LONGEST`.
    """
    if "__str__" in vars(type(result)):
        return shortened(str(result).partition("\n")[0], _LONGEST)
    names = [one.name for one in fields(result)] if is_dataclass(result) else result._fields
    values = ((name, getattr(result, name)) for name in names)
    shown = [f"{name}={_describe_value(value)}" for name, value in values if not _is_empty(value)]
    name = type(result).__name__
    return f"{name}({_join_fitting(shown, ', ', _LONGEST - len(name) - 2)})"


def _join_fitting(parts: Sequence[str], between: str, most: int) -> str:
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
    if isinstance(value, Record) and isinstance(name := getattr(value, "name", None), str):
        return f"{type(value).__name__} {shortened(visible(name), _LONGEST_WORD)!r}"
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
