"""Where a log's columns come from: ``value = factor * column + offset`` of a file, read and written as text.

The grammar of an entry of a mapping from a file's own headers to the columns of a log:

- entry := target "=" expression | joint {"," joint} "=" joint {"," joint}
- expression := sum | [product "*"] "(" sum ")" {("*" | "/") factor}
- sum := [product "*"] column {("*" | "/") factor} {("+" | "-") product}
- product := factor {("*" | "/") factor}
- factor := a decimal number | "pi", with an optional sign
- column := [sign] a name without "*" | any name between double or single quotes

Names may hold signs: a number that is added to a name alone takes spaces round its sign, ``pos - 2048``, or brackets.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from gimbal_pin.errors import PLACE, UsageError, shortened
from gimbal_pin.rig.reading import read_yaml
from gimbal_pin.rig.types import Array

if TYPE_CHECKING:
    from gimbal_pin.rig.rig import Rig

_NUMBER = r"(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|pi)"
_FACTOR = rf"[+-]?{_NUMBER}"
"""A number of an expression, with its sign."""
_BARE_NAME = re.compile(r"[^\W\d][\w .\[\]]*")
"""Names that an expression of a mapping holds without quotes."""
_TERM = re.compile(rf"([*/]?)\s*({_FACTOR})")
_BEFORE = rf"\s*(?P<before>{_FACTOR}(?:\s*[*/]\s*{_FACTOR})*\s*\*\s*)?"
_AFTER = rf"(?:\s*[*/]\s*{_FACTOR})"
_PRODUCT = rf"{_NUMBER}(?:\s*[*/]\s*{_NUMBER})*"
_ADDEND = re.compile(rf"([+-])\s*({_PRODUCT})")
_BRACKETS = re.compile(rf"{_BEFORE}(?P<sign>[+-]?)\s*\((?P<sum>.*)\)(?P<after>{_AFTER}*)\s*")
_SUM = rf"""{_BEFORE}
    (?P<sign>[+-]?)\s*
    (?:"(?P<double>[^"]+)"|'(?P<single>[^']+)'|(?P<bare>[^"'*\s](?:[^*]*?[^*\s])??))
    (?:(?P<after>{_AFTER}+)(?P<added>(?:\s*[+-]\s*{_PRODUCT})*)|(?P<addend>(?:%s)*))\s*"""
_LONE_SUM = re.compile(
    _SUM % rf"\s+[+-]\s+{_PRODUCT}|\s*[+-]\s*(?:{_NUMBER}\s*[*/]\s*)*pi{_AFTER}*", re.VERBOSE
)
_CLOSED_SUM = re.compile(_SUM % rf"\s*[+-]\s*{_PRODUCT}", re.VERBOSE)

Entries = str | Path | Sequence[str | Path] | Mapping[str, str]
"""A mapping as it is given: ``target=expression`` or the path of a YAML file with a table of such, one or several; or
the table itself, target → expression."""
_LONGEST_EXPRESSION = 1000
"""Most characters of an expression: matching takes the square of that in time."""
_JOINT_PREFIXES = ("q", "dq", "ddq", "tau", "q_ref", "temp")
"""Prefixes of a joint's columns."""
ROW_COLUMN = "row"
"""Column that every log has beside its own: the sample's number from 0, for files of a known rate without times."""


@dataclass(frozen=True)
class Source:
    """``value = factor * column + offset - zero``.

    Attributes:
        column: Header in the file.
        factor: One unit of the column in SI units; finite and not zero.
        place: Where the mapping was stated; empty for a column that bears its name already, or another joint's.
        offset: Value at a reading of zero, in SI units, as the mapping states it.
        zero: Reading at the URDF's zero, as the rig states it, rad or m: see `Motor.encoder_zero`.
    """

    column: str
    factor: float = 1.0
    place: str = ""
    offset: float = 0.0
    zero: float = 0.0

    def convert(self, readings: Array) -> Array:
        """Return the values of a column's readings in SI units."""
        values = readings * self.factor
        shift = self.offset - self.zero
        return values + shift if shift else values

    def times(self, factor: float | str) -> str:
        """Return the expression of this times a number, or a product as text, such as ``pos1*0.5*pi/180``."""
        value, rest = (
            (self.factor, factor) if isinstance(factor, str) else (self.factor * factor, "")
        )
        numbers = [text for text in (f"{abs(value):.12g}", rest) if text not in ("", "1")]
        text = format_expression(self.column, "-" * (value < 0) + "*".join(numbers))
        offset = self.offset * _multiply(rest, 1.0 if isinstance(factor, str) else factor)
        return f"{text} {'-' if offset < 0 else '+'} {abs(offset):.12g}" if offset else text


def format_expression(column: str, factor: str) -> str:
    """Return what a mapping writes for a column times a factor, such as ``pos1*pi/180``."""
    sign, rest = ("-", factor[1:]) if factor.startswith("-") else ("", factor)
    bare = _BARE_NAME.fullmatch(column) and not re.fullmatch(_FACTOR, column)
    quote = "'" if '"' in column else '"'
    shown = column if bare else f"{quote}{column}{quote}"
    return f"{sign}{shown}" + (f"*{rest}" if rest else "")


def format_remapping(
    sources: Mapping[str, Source], changes: Mapping[str, tuple[str, float | str]]
) -> str:
    """Return the ``--map`` entries, as a shell takes them, that mend a log read from these sources.

    Args:
        sources: Target → what it was read from; one that is missing bears its name in the file.
        changes: Target → (what is read as now, times which number or product), such as ``{"tau_a": ("tau_b", -1.0)}``.
    """
    entries = (
        f"{to}={sources.get(of, Source(of)).times(factor)}" for to, (of, factor) in changes.items()
    )
    return " ".join(f"--map {shlex.quote(entry)}" for entry in entries)


def read_mapping(entries: Entries = ()) -> dict[str, Source]:
    """Return target → source of all entries.

    Args:
        entries: The mapping; entries given as text come after those from files, and the later of two counts.

    Raises:
        UsageError: An entry that does not follow the grammar.
    """
    sources = dict[str, Source]()
    stated = list[str]()
    for entry in [entries] if isinstance(entries, (str, Path, Mapping)) else entries:
        if isinstance(entry, Mapping):
            _add_table(sources, entry, "mapping")
        elif is_mapping_file(entry):
            _add_table(sources, read_yaml(entry), str(entry))
        else:
            stated.append(str(entry))
    for entry in stated:
        _add_entry(sources, *parse_entry(entry))
    return sources


def _add_table(sources: dict[str, Source], table: object, place: str) -> None:
    """Add a table of target → expression; `UsageError` if it is none."""
    if not isinstance(table, Mapping):
        raise UsageError(
            place, "is no table of columns", "write one line 'q_yaw: pos1*pi/180' per column"
        )
    for target, text in table.items():
        where = f"{place}: {shortened(target, PLACE // 2)}"
        if not isinstance(text, str):
            raise UsageError(
                where, f"maps to {text!r}, which is no text", "quote it: 'column*factor'"
            )
        _add_entry(sources, target, parse_expression(text, where))


def is_mapping_file(entry: str | Path) -> bool:
    """Whether an entry names a file: it ends in .yaml or .yml, and has no = or is there."""
    return Path(entry).suffix.lower() in (".yaml", ".yml") and (
        "=" not in str(entry) or Path(entry).is_file()
    )


def _add_entry(sources: dict[str, Source], target: str, source: Source) -> None:
    """Add a target, or let joints exchange all that was mapped to them so far: ``yaw,pitch = pitch,yaw``."""
    joints = target.split(",")
    others = source.column.split(",")
    if len(joints) == 1 or sorted(joints) != sorted(others):
        sources[target] = source
        return
    before = dict(sources)
    for joint, other in zip(joints, others):
        for kind in _JOINT_PREFIXES:
            name = f"{kind}_{other}"
            sources[f"{kind}_{joint}"] = before.get(name, Source(name))


def parse_entry(entry: str) -> tuple[str, Source]:
    """Return (target, source) of ``target=expression``; `UsageError` quotes an entry that is none."""
    target, equals, text = entry.partition("=")
    if not (equals and target.strip()):
        raise UsageError(
            f"mapping '{entry}'", "is not of the form target=column", "write e.g. q_yaw=pos1*pi/180"
        )
    return target.strip(), parse_expression(text, f"mapping '{entry}'")


def parse_expression(text: str, place: str) -> Source:
    """Return the column, the factor and the offset of an expression, see the module's grammar.

    Raises:
        UsageError: `text` is too long, does not follow the grammar, or its numbers are zero or not finite.
    """
    if len(text) > _LONGEST_EXPRESSION:
        mend = f"give at most {_LONGEST_EXPRESSION}: a column and a factor"
        raise UsageError(place, f"has {len(text)} characters", mend)
    brackets = _BRACKETS.fullmatch(text)
    is_closed = brackets is not None or '"' in text or "'" in text  # no sign belongs to the name
    match = (_CLOSED_SUM if is_closed else _LONE_SUM).fullmatch(
        brackets["sum"] if brackets else text
    )
    if match is None:
        what = "is not one column times or divided by numbers and pi, plus a number"
        raise UsageError(place, what, "write e.g. pos*2*pi/4096 - pi; quote a name that holds a *")
    column = match["double"] or match["single"] or match["bare"]
    if match["bare"] and re.fullmatch(_FACTOR, column):
        raise UsageError(
            place, "names no column, only numbers", f"name one, or quote it: '\"{column}\"'"
        )
    scale = _scale_of(brackets) if brackets else 1.0
    factor = scale * _scale_of(match)
    addends = _ADDEND.findall(match["added"] or match["addend"] or "")
    offset = scale * sum(
        _multiply(number) * (-1.0 if minus == "-" else 1.0) for minus, number in addends
    )
    if factor == 0 or not math.isfinite(factor + offset):
        raise UsageError(
            place,
            f"has the factor {factor:g} and the offset {offset:g}",
            "give finite numbers, no zero",
        )
    return Source(column, factor, place, offset)


def _scale_of(match: re.Match[str]) -> float:
    """Return the product of the sign and of the numbers before and after a column or a pair of brackets."""
    sign = -1.0 if match["sign"] == "-" else 1.0
    return sign * _multiply(match["before"] or "", _multiply(match["after"] or ""))


def _multiply(text: str, start: float = 1.0) -> float:
    """Return `start` times or divided by the factors in `text`, left to right; NaN after a division by zero."""
    value = start
    for operator, factor in _TERM.findall(text):
        number = (
            math.copysign(math.pi, -1.0 if factor[0] == "-" else 1.0)
            if "pi" in factor
            else float(factor)
        )
        value = value * number if operator != "/" else value / number if number else math.nan
    return value


def list_encoder_sources(
    rig: Rig, sources: Mapping[str, Source] = MappingProxyType({})
) -> dict[str, Source]:
    """Return angle and reference column → source of the joints whose encoders do not read zero at the URDF's zero."""
    zeros = {
        joint: motor.encoder_zero
        for joint, motor in zip(rig.joints, rig.motors)
        if motor.encoder_zero
    }
    names = (
        (f"{prefix}_{joint}", zero) for joint, zero in zeros.items() for prefix in ("q", "q_ref")
    )
    return {name: replace(sources.get(name, Source(name)), zero=zero) for name, zero in names}


def check_targets(
    sources: Mapping[str, Source], known: Sequence[str], joints: Sequence[str]
) -> None:
    """Raise `UsageError` if a mapping's target is none of the `known` columns, or if two joints share one source."""
    for target, source in sources.items():
        exchanged = not source.place and any(target.endswith(f"_{joint}") for joint in joints)
        if target not in known and not exchanged:
            mend = f"targets are t, q_<joint>, dq_, tau_, …, with the joints {', '.join(joints)}; links as in the URDF"
            raise UsageError(
                source.place or "mapping", f"'{target}' is no column of this rig", mend
            )
    for kind in ("q", "dq", "tau", "q_ref"):
        owners: dict[str, str] = {}
        for target in (f"{kind}_{joint}" for joint in joints):
            source = sources.get(target, Source(target))  # a column that bears its name is its own
            other = owners.setdefault(source.column, target)
            if other != target:
                place = source.place or sources[other].place
                what = f"column '{source.column}' is both {other} and {target}"
                raise UsageError(
                    place, what, "give each joint a column of its own, or leave one of the two out"
                )
