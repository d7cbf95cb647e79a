"""Mappings ``target = factor * source`` from a file's own headers to the CONTRACT's columns.

The grammar of an entry:

- entry := target "=" expression | joint {"," joint} "=" joint {"," joint}
- expression := [product "*"] column {("*" | "/") factor}
- product := factor {("*" | "/") factor}
- factor := a decimal number | "pi", with an optional sign
- column := [sign] a name without "*" | any name between double or single quotes
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from gimbal_pin.errors import UsageError
from gimbal_pin.log.source import FACTOR, Source
from gimbal_pin.rig.reading import read_yaml

TERM = re.compile(rf"([*/]?)\s*({FACTOR})")
EXPRESSION = re.compile(
    rf"""\s*(?P<before>{FACTOR}(?:\s*[*/]\s*{FACTOR})*\s*\*\s*)?
         (?P<sign>[+-]?)\s*
         (?:"(?P<double>[^"]+)"|'(?P<single>[^']+)'|(?P<bare>[^"'*\s](?:[^*]*?[^*\s])??))
         (?P<after>(?:\s*[*/]\s*{FACTOR})*)\s*""",
    re.VERBOSE,
)

Entries = str | Path | Sequence[str | Path] | Mapping[str, str]
"""A mapping as it is given: ``target=expression`` or the path of a YAML file with a table of such, one or several; or
the table itself, target → expression."""
LONGEST = 1000
"""Most characters of an expression: matching takes the square of that in time."""
KINDS = ("q", "dq", "ddq", "tau", "q_ref", "temp")
"""Prefixes of a joint's columns."""
ROW = "row"
"""Column that every log has beside its own: the sample's number from 0, for files of a known rate without times."""


def read_mapping(entries: Entries = ()) -> dict[str, Source]:
    """Return target → source of all entries.

    Args:
        entries: The mapping; entries given as text come after those from files, and the later of two counts.

    Raises:
        UsageError: An entry that does not follow the grammar.
    """
    sources, stated = dict[str, Source](), list[str]()
    for entry in [entries] if isinstance(entries, (str, Path, Mapping)) else entries:
        if isinstance(entry, Mapping):
            add_table(sources, entry, "mapping")
        elif is_file(entry):
            add_table(sources, read_yaml(entry), str(entry))
        else:
            stated.append(str(entry))
    for entry in stated:
        add(sources, *parse_entry(entry))
    return sources


def add_table(sources: dict[str, Source], table: object, place: str) -> None:
    """Add a table of target → expression; `UsageError` if it is none."""
    if not isinstance(table, Mapping):
        raise UsageError(place, "is no table of columns", "write one line 'q_yaw: pos1*pi/180' per column")
    for target, text in table.items():
        if not isinstance(text, str):
            mend = "quote it: 'column*factor'"
            raise UsageError(f"{place}: {target}", f"maps to {text!r}, which is no text", mend)
        add(sources, target, parse_expression(text, f"{place}: {target}"))


def is_file(entry: str | Path) -> bool:
    """Whether an entry names a file: it ends in .yaml or .yml, and has no = or is there."""
    return Path(entry).suffix.lower() in (".yaml", ".yml") and ("=" not in str(entry) or Path(entry).is_file())


def add(sources: dict[str, Source], target: str, source: Source) -> None:
    """Add a target, or let joints exchange all that was mapped to them so far: ``yaw,pitch = pitch,yaw``."""
    joints, others = target.split(","), source.column.split(",")
    if len(joints) == 1 or sorted(joints) != sorted(others):
        sources[target] = source
        return
    before = dict(sources)
    for joint, other in zip(joints, others):
        for kind in KINDS:
            name = f"{kind}_{other}"
            sources[f"{kind}_{joint}"] = before.get(name, Source(name))


def parse_entry(entry: str) -> tuple[str, Source]:
    """Return (target, source) of ``target=expression``; `UsageError` quotes an entry that is none."""
    target, equals, text = entry.partition("=")
    if not (equals and target.strip()):
        raise UsageError(f"mapping '{entry}'", "is not of the form target=column", "write e.g. q_yaw=pos1*pi/180")
    return target.strip(), parse_expression(text, f"mapping '{entry}'")


def parse_expression(text: str, place: str) -> Source:
    """Return the column and the factor of ``[product*]column{*factor | /factor}``.

    Raises:
        UsageError: `text` is too long, does not follow the grammar, or its factor is zero or not finite.
    """
    if len(text) > LONGEST:
        raise UsageError(place, f"has {len(text)} characters", f"give at most {LONGEST}: a column and a factor")
    match = EXPRESSION.fullmatch(text)
    if match is None:
        what = "is not one column times or divided by numbers and pi"
        raise UsageError(place, what, "write e.g. pos*pi/180, without brackets; quote a name that holds a *")
    column = match["double"] or match["single"] or match["bare"]
    if match["bare"] and re.fullmatch(FACTOR, column):
        raise UsageError(place, "names no column, only numbers", f"name one, or quote it: '\"{column}\"'")
    sign = -1.0 if match["sign"] == "-" else 1.0
    factor = sign * product(match["before"] or "", product(match["after"]))
    if factor == 0 or not math.isfinite(factor):
        raise UsageError(place, f"has the factor {factor:g}", "give a finite factor other than zero")
    return Source(column, factor, place)


def product(text: str, start: float = 1.0) -> float:
    """Return `start` times or divided by the factors in `text`, left to right; NaN after a division by zero."""
    value = start
    for operator, factor in TERM.findall(text):
        number = math.copysign(math.pi, -1.0 if factor[0] == "-" else 1.0) if "pi" in factor else float(factor)
        value = value * number if operator != "/" else value / number if number else math.nan
    return value


def check_targets(sources: Mapping[str, Source], known: Sequence[str], joints: Sequence[str]) -> None:
    """Raise `UsageError` if a mapping's target is none of the `known` columns, or if two joints share one source."""
    for target, source in sources.items():
        exchanged = not source.place and any(target.endswith(f"_{joint}") for joint in joints)
        if target not in known and not exchanged:
            mend = f"targets are t, q_<joint>, dq_, tau_, …, with the joints {', '.join(joints)}; links as in the URDF"
            raise UsageError(source.place or "mapping", f"'{target}' is no column of this rig", mend)
    for kind in ("q", "dq", "tau", "q_ref"):
        owners: dict[str, str] = {}
        for target in (f"{kind}_{joint}" for joint in joints):
            source = sources.get(target, Source(target))  # a column that bears its name is its own
            other = owners.setdefault(source.column, target)
            if other != target:
                place = source.place or sources[other].place
                what = f"column '{source.column}' is both {other} and {target}"
                raise UsageError(place, what, "give each joint a column of its own, or leave one of the two out")
