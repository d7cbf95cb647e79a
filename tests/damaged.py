"""Strategies of damaged files: a valid file's bytes, table, arrays, tree of values or XML with up to three faults."""

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
    "nan", "inf", "-inf", "1e400", "1e300", "-1e300", "1e160", "1e-320", "5e-324", "-0", "0", "-1", "1e18", "9" * 400,
    "0." + "0" * 400 + "1", "1e" + "9" * 30, "", " ", "text", "1_0", "0x1", "1,5", "1e", "--1", "1 2", "\u0661\u0662",
    "1\u00a0", "null", "true", "=1+1",
)  # fmt: skip
"""Extreme numbers, and texts that are no number."""
TEXTS = (
    "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "a\rb", "a\nb", "tab\there", "\x7f", "\x9b31m", "\u202egnp", "\u2028",
    "\ufeff", "\u00e9" * 200, "x" * 5000, "../../x", "a,b", 'a"b', "a=b*2", "a@b", "%s%n{0}", "-o", "<b>&amp;</b>",
    "q_", "nan", "base", "fixed", "",
)  # fmt: skip
"""Names with control characters, marks of writing direction, separators, and of great length."""
FILES_MARKS = (
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\x1f\x8b",
    b"PK\x03\x04",
    b"PAR1",
    b"\x89HDF\r\n\x1a\n",
    b"#!",
    b"\0",
)
"""First bytes of other kinds of files, and of text in other encodings."""
INSERTED = (b"\0", b"\xff", b"\xc3\x28", b"\xed\xa0\x80", b"\x1b[2J", b"\r", b"\x1a", b"\xef\xbb\xbf", b"9" * 10**5,
            b'"', b"<", b"&")  # fmt: skip
numbers = st.sampled_from(NUMBERS) | st.floats(width=32).map(repr)
texts = st.sampled_from(TEXTS)

Draw = st.DrawFn


def choose(draw: Draw, items: Any) -> Any:
    """Draw one item of a sequence."""
    return draw(st.sampled_from(list(items)))


# --- Bytes ----------------------------------------------------------------------------------------------------------

BYTE_CHANGES: Mapping[str, Callable[[bytes, int, int], bytes]] = {
    "a bit flipped": lambda data, a, b: (
        data[:a] + bytes(x ^ 1 << b % 8 for x in data[a : a + 1]) + data[a + 1 :]
    ),
    "bytes inverted": lambda data, a, b: data[:a] + bytes(x ^ 255 for x in data[a:b]) + data[b:],
    "zeros": lambda data, a, b: data[:a] + bytes(b - a) + data[b:],
    "cut off": lambda data, a, b: data[:a],
    "a block missing": lambda data, a, b: data[:a] + data[b:],
    "a block twice": lambda data, a, b: data[:b] + data[a:],
    "inserted": lambda data, a, b: data[:a] + INSERTED[b % len(INSERTED)] + data[a:],
    "a start of another file": lambda data, a, b: FILES_MARKS[a % len(FILES_MARKS)] + data,
    "another encoding": lambda data, a, b: data.decode("utf-8", "replace").encode(
        ("utf-16", "utf-32")[a % 2]
    ),
    "other line ends": lambda data, a, b: data.replace(b"\n", (b"\r\n", b"\r")[a % 2]),
}


@st.composite
def damaged_bytes(draw: Draw, data: bytes) -> bytes:
    """A file with one to three faults below its format."""
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.sampled_from((1, 2, 8, 64, 4096))))
        data = BYTE_CHANGES[choose(draw, BYTE_CHANGES)](data, start, end)
    return data


# --- Tables ---------------------------------------------------------------------------------------------------------

Rows = list[list[str]]
"""The header, then the samples; every row of one width until a row of another width is made."""


def scale_column(draw: Draw, rows: Rows, column: int) -> None:
    """Multiply a column by a power of ten, or add one to it."""
    size = 10.0 ** draw(st.integers(-300, 300))
    is_factor = draw(st.booleans())
    for row in rows[1:]:
        try:
            value = float(row[column])
        except ValueError:
            continue
        row[column] = repr(value * size if is_factor else value + size)


def replace_cells(draw: Draw, rows: Rows, column: int) -> None:
    """Write one value into one row, some rows or all of a column."""
    value = draw(numbers)
    first = draw(st.integers(1, len(rows)))
    for row in rows[first : first + choose(draw, (1, 3, 50, len(rows)))]:
        row[column] = value


def move_rows(draw: Draw, rows: Rows, column: int) -> None:
    """Delete, double, reverse or move a block of rows."""
    start = draw(st.integers(1, len(rows)))
    end = start + choose(draw, (1, 2, 30, 200, len(rows)))
    block = deepcopy(rows[start:end])
    how = choose(draw, ("gone", "twice", "reversed", "moved", "rest gone"))
    if how != "twice":
        del rows[start : len(rows) if how == "rest gone" else end]
    if how in ("twice", "reversed"):
        rows[start:start] = block[::-1] if how == "reversed" else block
    if how == "moved":
        rows.extend(block)


def change_columns(draw: Draw, rows: Rows, column: int) -> None:
    """Rename, delete, double or exchange a column, or take the header away."""
    other = draw(st.integers(0, len(rows[0]) - 1))
    how = choose(draw, ("text", "text", "name twice", "gone", "twice", "exchanged", "no header"))
    if how in ("text", "name twice"):
        rows[0][column] = draw(texts) if how == "text" else rows[0][other]
    elif how == "gone":
        rows[:] = [row[:column] + row[column + 1 :] for row in rows]
    elif how == "twice":
        rows[:] = [[*row, row[column]] for row in rows]
    elif how == "exchanged":
        rows[0][column], rows[0][other] = rows[0][other], rows[0][column]
    else:
        del rows[0]


def widen(draw: Draw, rows: Rows, column: int) -> None:
    """Add 300 columns of zeros, or change the width of one row."""
    how = choose(draw, ("wide", "shorter", "longer", "much longer"))
    row = choose(draw, rows)
    if how == "wide":
        rows[:] = [
            [*row, *(f"c{k}" if row is rows[0] else "0" for k in range(300))] for row in rows
        ]
    elif how == "shorter":
        row.pop()
    else:
        row.extend(["1"] * (1 if how == "longer" else 1000))


TABLE_CHANGES = (
    replace_cells,
    replace_cells,
    scale_column,
    move_rows,
    change_columns,
    change_columns,
    widen,
)


@st.composite
def damaged_table(draw: Draw, data: bytes) -> bytes:
    """A CSV table with one to three faults, of its bytes or of its values."""
    if draw(st.sampled_from((False, False, True))):
        return draw(damaged_bytes(data))
    rows = [line.split(",") for line in data.decode().splitlines()]
    for _ in range(draw(st.integers(1, 3))):
        if len({len(row) for row in rows}) == 1 and rows[0]:
            choose(draw, TABLE_CHANGES)(draw, rows, draw(st.integers(0, len(rows[0]) - 1)))
    separator = choose(draw, (",", ",", ",", ";", "\t", " ", ", "))
    return "".join(separator.join(row) + "\n" for row in rows).encode("utf-8", "surrogatepass")


# --- Arrays ---------------------------------------------------------------------------------------------------------

ARRAY_CHANGES: Mapping[str, Callable[[Array], Any]] = {
    "float16": lambda x: x.astype(np.float16),
    "integers": lambda x: np.round(1000 * x).astype(np.int64),
    "large integers": lambda x: np.full(len(x), 2**62),
    "unsigned": lambda x: np.abs(np.round(x)).astype(np.uint8),
    "booleans": lambda x: x > 0,
    "texts": lambda x: x.astype(str),
    "escapes": lambda x: np.full(len(x), b"\x1b[31m"),
    "times": lambda x: np.round(1e6 * x).astype("datetime64[us]"),
    "no times": lambda x: np.full(len(x), np.datetime64("NaT", "ns")),
    "constant": lambda x: np.full(len(x), x[0] if len(x) else 0.0),
    "reversed": lambda x: x[::-1],
    "rounded": lambda x: np.round(x),
    "some missing": lambda x: np.where(np.arange(len(x)) % 7 == 3, np.nan, x),
    **{f"all {value:g}": lambda x, value=value: np.full(len(x), value)
       for value in (np.nan, np.inf, 1e300, 1e160, 1e-320, 0.0)},
}  # fmt: skip
SHAPE_CHANGES: Mapping[str, Callable[[Array], Any]] = {
    "complex": lambda x: x + 1j,
    "a scalar": lambda x: np.float64(1.0),
    "a column": lambda x: x[:, None],
    "two columns": lambda x: np.column_stack([x, x]),
    "three dimensions": lambda x: np.zeros((len(x), 2, 2)),
    "no columns": lambda x: np.zeros((len(x), 0)),
    "a wide array": lambda x: np.zeros((len(x), 3000)),
    "shorter": lambda x: x[:-1],
    "empty": lambda x: x[:0],
}
"""Changes that only an archive of arrays can hold."""


@st.composite
def damaged_columns(
    draw: Draw, columns: Mapping[str, Array], changes: Mapping[str, Callable[[Array], Any]]
) -> Any:
    """Named arrays with one to three of another type, name or length, missing, or with 3 000 more."""
    rows = draw(st.sampled_from((0, 1, 2, 10, *[len(columns["t"])] * 8)))
    found: dict[str, Any] = {name: x[:rows] for name, x in columns.items()}
    for _ in range(draw(st.integers(1, 3))):
        name = choose(draw, columns)
        how = choose(draw, ("type", "type", "type", "name", "gone", "wide"))
        if how == "type":
            found[name] = changes[choose(draw, changes)](columns[name][:rows])
        elif how == "wide":
            found |= {f"column{k}": np.zeros(rows) for k in range(3000)}
        elif (x := found.pop(name, None)) is not None and how == "name":
            found[draw(texts).replace("\0", "")] = x
    return found


# --- Trees of YAML and JSON -----------------------------------------------------------------------------------------

TOKEN = "RAWVALUE"
"""A value in the tree that is replaced in the text by one of `RAW_VALUES`."""
BOMB = "[&a [x, x, x, x, x, x, x, x]" + "".join(
    f", &{name} [{', '.join([f'*{of}'] * 8)}]" for of, name in zip("abcde", "bcdef")
)
RAW_VALUES = (
    "!!python/object/apply:os.system [id]", "!!bool x", "!!int x", "!!float x", "!!binary '*'", "!!timestamp x",
    "!!set {a, b}", "!!omap [a: 1]", "!!map [1]", "!own 1", "*nothing", "&a [*a]", "&a {b: *a}", f"{BOMB}]",
    "{<<: [&m {a: 1}, " + "*m, " * 500 + "*m]}", "[" * 20_000, "[" * 500 + "]" * 500, "{a: " * 300 + "1" + "}" * 300,
    '{"a": ' * 3000 + "1" + "}" * 3000, "- " * 3000 + "1", "2001-99-99", "190:20:30", "0x" + "f" * 400, "9" * 5000,
    ".nan", "-.inf", "1e400", "NaN", "Infinity", "~", "''", "{1: 2}", "{[1]: 2}", "yes", '"\\e[31m"', '"\\0"',
    '"\\ud800"', '"a\\nb"', "@x", "%x", "'unclosed", "[unclosed", "\t- x", "#", "---\n---", "a: b: c", "{a, a}",
)  # fmt: skip
VALUES = (
    TOKEN, None, True, False, "", [], [[]], {}, 0, -1, 1, 1.5, 1e-300, 1e16, 1e300, float("nan"), float("inf"),
    "1e-3", [1, 2], {"a": 1},
)  # fmt: skip


def list_paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of every value below one, of a long list those of its ends alone."""
    if isinstance(value, list):
        keys: list[Any] = [*range(len(value))] if len(value) < 30 else [0, 1, len(value) - 1]
    else:
        keys = list(value) if isinstance(value, dict) else []
    return [
        found for key in keys for found in ((*path, key), *list_paths(value[key], (*path, key)))
    ]


def get_at(value: Any, path: tuple[Any, ...]) -> Any:
    """Return the value at a path."""
    for key in path:
        value = value[key]
    return value


def replace_value(draw: Draw, owner: Any, key: Any, tree: Any) -> None:
    """Write another value, of the same kind or of any."""
    before = owner[key]
    is_number = isinstance(before, (int, float)) and not isinstance(before, bool)
    how = choose(draw, ("any", "alike", "alike"))
    if how == "alike" and is_number:
        owner[key] = float(before) * draw(
            st.sampled_from((-1.0, 0.0, 1e-300, 1e300, 1e-9, 1e-3, 1e3, 1e9))
        )
    elif how == "alike" and isinstance(before, list):
        others = (
            before[:-1],
            before + before,
            before[::-1],
            [before],
            before * 50,
            [None] * len(before),
        )
        owner[key] = deepcopy(choose(draw, others))
    elif how == "alike" and isinstance(before, str):
        owner[key] = draw(texts)
    else:
        owner[key] = deepcopy(choose(draw, VALUES))


def change_keys(draw: Draw, owner: Any, key: Any, tree: Any) -> None:
    """Delete, double or rename an entry, or add one."""
    how = choose(draw, ("gone", "gone", "other", "more"))
    if isinstance(owner, list):
        value = owner.pop(key)
        owner += {"gone": [], "other": [value], "more": [value, value]}[how]
        return
    name = choose(
        draw, (*TEXTS, 1, 1.5, True, None, TOKEN, "schema", "kind", "payloads", "urdf", "wish")
    )
    if how == "more":
        owner[name] = choose(draw, (1, "x", None, [], {}))
    else:
        value = owner.pop(key)
        owner |= {name: value} if how == "other" else {}


def exchange_values(draw: Draw, owner: Any, key: Any, tree: Any) -> None:
    """Write a copy of a value of the tree in place of another."""
    owner[key] = deepcopy(get_at(tree, choose(draw, list_paths(tree))))


TREE_CHANGES = (replace_value, replace_value, replace_value, change_keys, exchange_values)


@st.composite
def damaged_tree(draw: Draw, tree: Any) -> Any:
    """A tree of tables, lists and values with one to three of its entries changed."""
    tree = deepcopy(tree)
    for _ in range(draw(st.integers(1, 3))):
        if paths := list_paths(tree):
            path = choose(draw, paths)
            choose(draw, TREE_CHANGES)(draw, get_at(tree, path[:-1]), path[-1], tree)
    return tree


@st.composite
def damaged_yaml(draw: Draw, data: bytes) -> bytes:
    """A YAML file with one to three faults, of its bytes or of its values."""
    if draw(st.sampled_from((False, False, True))):
        return draw(damaged_bytes(data))
    tree = draw(damaged_tree(yaml.safe_load(data)))
    text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
    return text.replace(TOKEN, choose(draw, RAW_VALUES)).encode("utf-8", "surrogatepass")


@st.composite
def damaged_json(draw: Draw, data: bytes) -> bytes:
    """A JSON file with one to three faults, of its bytes or of its values; as one text, or a record a line."""
    if draw(st.sampled_from((False, False, True))):
        return draw(damaged_bytes(data))
    tree = draw(damaged_tree(json.loads(data)))
    is_by_line = isinstance(tree, list) and draw(st.booleans())
    text = "\n".join(map(json.dumps, tree)) if is_by_line else json.dumps(tree)
    return text.replace(f'"{TOKEN}"', choose(draw, RAW_VALUES)).encode("utf-8", "surrogatepass")


# --- XML ------------------------------------------------------------------------------------------------------------

ENTITIES = (
    '<!DOCTYPE robot [<!ENTITY file SYSTEM "file:///etc/hostname"><!ENTITY a "lol">'
    + "".join(f'<!ENTITY {name} "{f"&{of};" * 8}">' for of, name in zip("abcdef", "bcdefg"))
    + "]>"
)
RAW_XML = (
    "&g;",
    "&file;",
    "&#27;[31m",
    "&#0;",
    "&nothing;",
    "<",
    "\x1b[31m",
    "]]>",
    "&#10;",
    "\0",
    "<!--",
)
TYPES = (
    "prismatic",
    "floating",
    "planar",
    "continuous",
    "revolute",
    "fixed",
    "spherical",
    "",
    "REVOLUTE",
)
TAGS = (
    "link",
    "joint",
    "inertial",
    "mass",
    "origin",
    "axis",
    "limit",
    "mimic",
    "transmission",
    "dynamics",
    "a",
)
MESH_NAMES = (
    "no.stl", "../../etc/hostname", "package://no/mesh.stl", "/dev/zero", "pan.urdf", "x" * 5000, "", ".",
    "http://x/y.stl",
)  # fmt: skip


def change_attribute(draw: Draw, part: Any, parts: list[Any]) -> None:
    """Delete, rename or replace an attribute."""
    if not part.attrib:
        return
    key = choose(draw, sorted(part.attrib))
    words = part.get(key).split()
    how = choose(draw, ("value", "value", "value", "gone", "renamed", "raw"))
    value = TOKEN if how == "raw" else None if how == "gone" else draw(numbers)
    if key in ("name", "link", "joint") and how == "value":
        value = draw(texts)
    elif key in ("type", "filename") and how == "value":
        value = choose(draw, TYPES if key == "type" else MESH_NAMES)
    elif len(words) > 1 and how == "value" and draw(st.booleans()):
        words[draw(st.integers(0, len(words) - 1))] = str(value)
        value = " ".join(words)
    if how in ("gone", "renamed"):
        del part.attrib[key]
    if value is not None:
        clean = "".join(mark for mark in value if mark >= " " or mark in "\t\n\r")
        part.set("other" if how == "renamed" else key, clean)


def change_element(draw: Draw, part: Any, parts: list[Any]) -> None:
    """Delete, double, move or rename an element."""
    how = choose(draw, ("gone", "gone", "twice", "elsewhere", "renamed"))
    if how == "renamed":
        part.tag = choose(draw, TAGS)
    elif how == "gone":
        part.getparent().remove(part)
    else:
        target = choose(draw, parts) if how == "elsewhere" else part.getparent()
        target.append(deepcopy(part))


def append_chain(draw: Draw, part: Any, parts: list[Any]) -> None:
    """Add joints and links one behind another, or beside one another, or elements inside elements."""
    count = choose(draw, (1, 3, 30, 300))
    kind = choose(draw, (*TYPES[:6], "nested"))
    is_chain = draw(st.booleans())
    robot = part.getroottree().getroot()
    parent = "arm"
    for k in range(count):
        if kind == "nested":
            part = etree.SubElement(part, "a")
            continue
        etree.SubElement(robot, "link", name=f"more{k}")
        joint = etree.SubElement(robot, "joint", name=f"jmore{k}", type=kind)
        etree.SubElement(joint, "parent", link=parent)
        etree.SubElement(joint, "child", link=f"more{k}")
        etree.SubElement(joint, "axis", xyz="0 0 1")
        etree.SubElement(joint, "limit", lower="-1", upper="1", velocity="1", effort="1")
        parent = f"more{k}" if is_chain else parent


XML_CHANGES = (change_attribute, change_attribute, change_attribute, change_element, append_chain)


@st.composite
def damaged_xml(draw: Draw, data: bytes) -> bytes:
    """An XML file with one to three faults, of its bytes or of its elements."""
    if draw(st.sampled_from((False, False, False, True))):
        return draw(damaged_bytes(data))
    robot = etree.fromstring(data)
    for _ in range(draw(st.integers(1, 3))):
        if parts := [
            part for part in robot.iter() if isinstance(part.tag, str) and part is not robot
        ]:
            choose(draw, XML_CHANGES)(draw, choose(draw, parts), parts)
    text = etree.tostring(robot, encoding="unicode")
    if TOKEN in text:
        raw = choose(draw, RAW_XML)
        text = (ENTITIES if raw in ("&g;", "&file;") else "") + text.replace(TOKEN, raw)
    return text.encode("utf-8", "surrogatepass")
