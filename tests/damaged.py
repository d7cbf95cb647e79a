"""Strategies of damaged files: a valid file's bytes, table, arrays, tree of values or XML with faults."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st
from lxml import etree

from gimbal_pin.log import Array

NUMBERS = (
    *("nan", "-inf", "1e400", "1e300", "1e160", "1e-320", "5e-324", "-0", "0", "-1", "9" * 400),
    *("1e" + "9" * 30, "", "text", "1_0", "0x1", "1,5", "--1", "\u0661\u0662", "1\u00a0", "null"),
)
"""Extreme numbers, and texts that are no number."""
TEXTS = (
    *("\x1b[31mred\x1b[0m", "a\rb", "a\nb", "\x9b31m", "\u202egnp", "\u2028", "\ufeff", "x" * 5000),
    *("../../x", "a,b", 'a"b', "a=b*2", "a@b", "%s%n{0}", "-o", "<b>&amp;</b>", "q_", "base", ""),
)
"""Names with control characters, marks of writing direction, separators, and of great length."""
INSERTED = (
    *(
        b"\0",
        b"\xff",
        b"\xc3\x28",
        b"\xed\xa0\x80",
        b"\x1b[2J",
        b"\r",
        b"\xef\xbb\xbf",
        b"9" * 10**5,
    ),
    *(b"\x1f\x8b", b"PK\x03\x04", b"PAR1", b"\x89HDF\r\n\x1a\n", b'"', b"<"),
)
"""Bytes that text has none of, and the first ones of other kinds of files."""
Draw = st.DrawFn


def choose(draw: Draw, *items: Any) -> Any:
    """Draw one item."""
    return draw(st.sampled_from(items))


# --- Bytes --------------------------------------------------------------------------------------

BYTE_CHANGES: tuple[Callable[[bytes, int, int], bytes], ...] = (
    lambda data, a, b: data[:a] + bytes(x ^ 1 << b % 8 for x in data[a : a + 1]) + data[a + 1 :],
    lambda data, a, b: data[:a] + bytes(x ^ 255 for x in data[a:b]) + data[b:],
    lambda data, a, b: data[:a],
    lambda data, a, b: data[:a] + data[b:],
    lambda data, a, b: data[:b] + data[a:],
    lambda data, a, b: data[: a % 2 * a] + INSERTED[b % len(INSERTED)] + data[a % 2 * a :],
    lambda data, a, b: data.decode("utf-8", "replace").encode("utf-16"),
    lambda data, a, b: data.replace(b"\n", b"\r"),
)
"""A bit or bytes inverted, zeros, an end or a block missing, a block twice, inserted bytes."""


@st.composite
def damaged_bytes(draw: Draw, data: bytes) -> bytes:
    """A file with one to three faults below its format."""
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + choose(draw, 1, 8, 64, 4096))
        data = choose(draw, *BYTE_CHANGES)(data, start, end)
    return data


# --- Tables -------------------------------------------------------------------------------------

Rows = list[list[str]]
"""The header, then the samples; all of one width until a row of another width is made."""


def replace_cells(draw: Draw, rows: Rows, column: int) -> None:
    """Write one value into one row, some rows or all of a column."""
    value = choose(draw, *NUMBERS)
    first = draw(st.integers(1, len(rows)))
    for row in rows[first : first + choose(draw, 1, 50, len(rows))]:
        row[column] = value


def move_rows(draw: Draw, rows: Rows, column: int) -> None:
    """Delete, double or reverse a block of rows."""
    start = draw(st.integers(1, len(rows)))
    end = start + choose(draw, 1, 30, len(rows))
    block = rows[start:end]
    rows[start:end] = choose(draw, [], block + deepcopy(block), block[::-1])


def change_columns(draw: Draw, rows: Rows, column: int) -> None:
    """Rename, delete or double a column, take the header away, or change the width of one row."""
    how = choose(draw, "renamed", "renamed", "gone", "twice", "no header", "shorter", "longer")
    if how == "renamed":
        rows[0][column] = choose(draw, *TEXTS, *rows[0])
    elif how == "no header":
        del rows[0]
    elif how in ("shorter", "longer"):
        row = choose(draw, *rows)
        row[:] = row[:-1] if how == "shorter" else [*row, *["1"] * choose(draw, 1, 1000)]
    else:
        rows[:] = [row[:column] + row[column + 1 - 2 * (how == "twice") :] for row in rows]


@st.composite
def damaged_table(draw: Draw, data: bytes) -> bytes:
    """A CSV table with one to three faults, of its bytes or of its values."""
    if choose(draw, False, False, True):
        return draw(damaged_bytes(data))
    rows = [line.split(",") for line in data.decode().splitlines()]
    for _ in range(draw(st.integers(1, 3))):
        if len({len(row) for row in rows}) == 1 and rows[0]:
            change = choose(draw, replace_cells, move_rows, change_columns)
            change(draw, rows, draw(st.integers(0, len(rows[0]) - 1)))
    separator = choose(draw, ",", ",", ";", "\t", " ")
    return "".join(separator.join(row) + "\n" for row in rows).encode("utf-8", "surrogatepass")


# --- Arrays -------------------------------------------------------------------------------------

ARRAY_CHANGES: tuple[Callable[[Array], Any], ...] = (
    lambda x: x.astype(np.float16),
    lambda x: np.full(len(x), 2**62),
    lambda x: x > 0,
    lambda x: x.astype(str),
    lambda x: np.round(1e6 * x).astype("datetime64[us]"),
    lambda x: np.full(len(x), np.datetime64("NaT", "ns")),
    lambda x: np.where(np.arange(len(x)) % 7 == 3, np.nan, x),
    *(lambda x, value=value: np.full(len(x), value) for value in (np.nan, np.inf, 1e300, 0.0)),
)
SHAPE_CHANGES: tuple[Callable[[Array], Any], ...] = (
    lambda x: x + 1j,
    lambda x: np.float64(1.0),
    lambda x: np.zeros((len(x), 2, 2)),
    lambda x: x[:-1],
    lambda x: x[:0],
)
"""Changes that only an archive of arrays can hold."""


@st.composite
def damaged_columns(
    draw: Draw, columns: Mapping[str, Array], changes: tuple[Callable[[Array], Any], ...]
) -> Any:
    """Named arrays with one to three of another type, name or length, or missing."""
    rows = choose(draw, 0, 1, 10, *[len(columns["t"])] * 6)
    found: dict[str, Any] = {name: x[:rows] for name, x in columns.items()}
    for _ in range(draw(st.integers(1, 3))):
        name = choose(draw, *columns)
        value = found.pop(name, columns[name][:rows])
        how = choose(draw, "type", "type", "name", "gone")
        if how == "type":
            found[name] = choose(draw, *changes)(columns[name][:rows])
        elif how == "name":
            found[choose(draw, *TEXTS)] = value
    return found


# --- Trees of YAML and JSON ---------------------------------------------------------------------

TOKEN = "RAWVALUE"
"""A value in the tree that is replaced in the text by one of `RAW_VALUES`."""
BOMB = "[&a [x, x, x, x, x, x, x, x]" + "".join(
    f", &{name} [{', '.join([f'*{of}'] * 8)}]" for of, name in zip("abcde", "bcdef")
)
RAW_VALUES = (
    *("!!python/object/apply:os.system [id]", "!!bool x", "!!int x", "!!binary '*'", "!own 1"),
    *("*nothing", "&a [*a]", f"{BOMB}]", "[" * 20_000, '{"a": ' * 3000 + "1" + "}" * 3000),
    *("2001-99-99", "0x" + "f" * 400, "9" * 5000, "-.inf", "1e400", "NaN", "Infinity", "~"),
    *("{[1]: 2}", "yes", '"\\e[31m"', '"\\0"', '"\\ud800"', '"a\\nb"', "'unclosed", "\t- x"),
    *("---\n---", "a: b: c", "{a, a}"),
)
VALUES = (TOKEN, None, True, "", [], [[]], {}, 0, -1, 1.5, 1e-300, 1e300, float("nan"), "1e-3", [1])


def list_places(value: Any) -> list[tuple[Any, Any]]:
    """Return owner and key of every value below one, of a long list those of its ends alone."""
    if isinstance(value, dict):
        keys: list[Any] = [*value]
    elif isinstance(value, list):
        keys = [*range(len(value))] if len(value) < 30 else [0, 1, len(value) - 1]
    else:
        return []
    return [place for key in keys for place in ((value, key), *list_places(value[key]))]


def change_value(draw: Draw, owner: Any, key: Any, tree: Any) -> None:
    """Write another value in its place: of the same kind, of any, or one from elsewhere."""
    before = owner[key]
    other, place = choose(draw, *list_places(tree))
    values = [*VALUES, deepcopy(other[place])]
    if isinstance(before, list):
        values += [before[:-1], before * 2, before[::-1], [before], before * 50] * 5
    elif isinstance(before, str):
        values += TEXTS
    elif isinstance(before, (int, float)):
        values += [before * x for x in (-1.0, 0.0, 1e-300, 1e300, 1e-9, 1e-3, 1e3, 1e9)] * 3
    owner[key] = deepcopy(choose(draw, *values))


def change_keys(draw: Draw, owner: Any, key: Any, tree: Any) -> None:
    """Delete an entry, or add one."""
    if isinstance(owner, list) or choose(draw, True, False):
        del owner[key]
    else:
        owner[choose(draw, *TEXTS, 1, None, TOKEN, "schema", "payloads")] = owner[key]


@st.composite
def damaged_tree(draw: Draw, data: bytes, read: Any, write: Any) -> bytes:
    """A file with one to three faults, of its bytes or of the values in it."""
    if choose(draw, False, False, True):
        return draw(damaged_bytes(data))
    tree = read(data)
    for _ in range(draw(st.integers(1, 3))):
        if places := list_places(tree):
            change = choose(draw, change_value, change_value, change_keys)
            change(draw, *choose(draw, *places), tree)
    text = write(tree).replace(f'"{TOKEN}"', TOKEN).replace(TOKEN, choose(draw, *RAW_VALUES))
    return text.encode("utf-8", "surrogatepass")


def damaged_yaml(data: bytes) -> st.SearchStrategy[bytes]:
    """A damaged YAML file."""
    return damaged_tree(data, yaml.safe_load, lambda tree: yaml.safe_dump(tree, allow_unicode=True))


def damaged_json(data: bytes) -> st.SearchStrategy[bytes]:
    """A damaged JSON file."""
    return damaged_tree(data, json.loads, json.dumps)


# --- XML ----------------------------------------------------------------------------------------

ENTITIES = (
    '<!DOCTYPE robot [<!ENTITY file SYSTEM "file:///etc/hostname"><!ENTITY a "lol">'
    + "".join(f'<!ENTITY {name} "{f"&{of};" * 8}">' for of, name in zip("abcdef", "bcdefg"))
    + "]>"
)
RAW_XML = ("&g;", "&file;", "&#27;[31m", "&#0;", "&nothing;", "<", "\x1b[31m", "]]>", "&#10;", "\0")
WORDS = (
    *("prismatic", "floating", "planar", "continuous", "spherical", "REVOLUTE", "no.stl", "."),
    *("../../etc/hostname", "package://no/mesh.stl", "/dev/zero", "pan.urdf", "http://x/y.stl"),
)
"""Types of joints, and places of meshes."""


def change_attribute(draw: Draw, part: Any, parts: list[Any]) -> None:
    """Delete, rename or replace an attribute, or one of its numbers."""
    if not part.attrib:
        return
    key = choose(draw, *sorted(part.attrib))
    words = part.attrib.pop(key).split() or [""]
    how = choose(draw, "number", "word", "text", "raw", "gone", "renamed")
    value = choose(draw, *{"number": NUMBERS, "word": WORDS, "text": TEXTS}.get(how, (TOKEN,)))
    if how == "number":
        words[draw(st.integers(0, len(words) - 1))] = value
        value = " ".join(words)
    if how != "gone":
        clean = "".join(mark for mark in value if mark >= " " or mark in "\t\n\r")
        part.set("other" if how == "renamed" else key, clean)


def change_element(draw: Draw, part: Any, parts: list[Any]) -> None:
    """Delete, copy, move or rename an element, or put many of them one into another."""
    how = choose(draw, "gone", "gone", "copied", "renamed", "nested")
    if how == "renamed":
        part.tag = choose(draw, "link", "joint", "mass", "limit", "mimic", "transmission", "a")
    elif how == "gone":
        part.getparent().remove(part)
    elif how == "copied":
        choose(draw, *parts, part.getparent()).append(deepcopy(part))
    else:
        for _ in range(300):
            part = etree.SubElement(part, part.tag)


@st.composite
def damaged_xml(draw: Draw, data: bytes) -> bytes:
    """An XML file with one to three faults, of its bytes or of its elements."""
    if choose(draw, False, False, False, True):
        return draw(damaged_bytes(data))
    robot = etree.fromstring(data)
    for _ in range(draw(st.integers(1, 3))):
        if parts := [part for part in robot.iterdescendants() if isinstance(part.tag, str)]:
            change = choose(draw, change_attribute, change_attribute, change_element)
            change(draw, choose(draw, *parts), parts)
    text = etree.tostring(robot, encoding="unicode")
    if TOKEN in text:
        raw = choose(draw, *RAW_XML)
        text = (ENTITIES if raw in ("&g;", "&file;") else "") + text.replace(TOKEN, raw)
    return text.encode("utf-8", "surrogatepass")
