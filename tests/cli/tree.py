"""The command tree: the options of every verb, nested ones too, and a value of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from inspect import Parameter, get_annotations, signature
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin

from tyro.constructors import PrimitiveConstructorSpec

from gimbal_pin.cli import VERBS
from gimbal_pin.cli.paths import Writes, label


class Option(NamedTuple):
    """One option.

    Attributes:
        parameter: The verb's parameter that holds it.
        name: Its own name, another one where the parameter holds several.
        kind: Its type.
        marks: What annotates it.
        default: Its default.
    """

    parameter: str
    name: str
    kind: Any
    marks: tuple[Any, ...]
    default: Any

    @property
    def called(self) -> str:
        """What it is called on the command line."""
        return label(self.name, self.marks)

    @property
    def bounds(self) -> PrimitiveConstructorSpec[Any] | None:
        """The bounds of a number."""
        return next((x for x in self.marks if isinstance(x, PrimitiveConstructorSpec)), None)

    @property
    def writes(self) -> Writes | None:
        """What it writes."""
        return next((x for x in self.marks if isinstance(x, Writes)), None)

    @property
    def sample(self) -> Any:
        """A value that is not the default, where it has several."""
        kinds = {self.kind, *get_args(self.kind)}
        if self.bounds:
            number = int if int in kinds else float
            return number(self.bounds.metavar.partition("..")[0])
        if bool in kinds:
            return not self.default
        if choices := [x for kind in kinds if get_origin(kind) is Literal for x in get_args(kind)]:
            return choices[-1]
        if Path in kinds:
            suffixes = self.writes.list_suffixes() if self.writes else ()
            return Path(f"{self.name}{suffixes[0] if suffixes else ''}")
        if tuple in map(get_origin, kinds):
            return ("a", "b")
        return "cinema" if self.name == "payload" else "turret"


def list_options(verb: str) -> Iterator[Option]:
    """Yield every option of a verb."""
    hints = get_annotations(VERBS[verb], eval_str=True)
    for name, parameter in signature(VERBS[verb]).parameters.items():
        default = parameter.default
        own = {name: hints[name]}
        if is_dataclass(default):
            own = get_annotations(type(default), eval_str=True)
        for inner, hint in own.items():
            marks = getattr(hint, "__metadata__", ())
            kind = get_args(hint)[0] if marks else hint
            value = getattr(default, inner) if is_dataclass(default) else default
            yield Option(name, inner, kind, marks, value)


def list_required(verb: str) -> list[Option]:
    """Return what a verb asks for."""
    return [one for one in list_options(verb) if one.default is Parameter.empty]


def fill(verb: str, option: Option) -> dict[str, Any]:
    """Return arguments of a verb: what it asks for, and a value of one option."""
    given = {one.parameter: one.sample for one in list_required(verb)}
    value = option.sample
    if option.name != option.parameter:
        default = signature(VERBS[verb]).parameters[option.parameter].default
        value = replace(default, **{option.name: value})
    return {**given, option.parameter: value}
