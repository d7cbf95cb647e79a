"""YAML of every kind: leaves and keys replaced, aliases, tags, nests."""

from __future__ import annotations

from copy import deepcopy
from itertools import pairwise
from typing import Any

import numpy as np
import yaml

from fuzzing.junk import one, text

TOKEN = "RAWYAML"
"""Stands in the data for what is put into the text."""

ANCHORS = ["a", "b", "c", "d", "e", "f"]
BOMB = (
    "[&a [x, x, x, x, x, x, x, x, x], "
    + ", ".join(f"&{name} [{', '.join([f'*{of}'] * 8)}]" for of, name in pairwise(ANCHORS))
    + ", [*f, *f, *f, *f, *f, *f, *f, *f]]"
)
"""Nine times eight times … eight."""
MERGES = "{<<: [" + "&m {a: 1}, " + "*m, " * 500 + "*m]}"
RAW = (
    "!!python/object/apply:os.system [id]", "!!python/name:os.system", "!!bool x", "!!int x", "!!int ''", "!!float x",
    "!!null x", "!!binary '*'",
    "!!timestamp x", "!!set {a, b}", "!!omap [a: 1]", "!!pairs [a: 1]", "!!map [1]", "!!seq {a: 1}", "!!str 1",
    "!own 1", "*nothing", "&a [*a]",
    "&a {b: *a}", BOMB, MERGES, "{<<: 1}", "{<<: [1]}", "[" * 20_000, "[" * 500 + "]" * 500,
    "{a: " * 300 + "1" + "}" * 300, "- " * 3000 + "1", "2001-12-14",
    "2001-99-99", "2001-12-14t21:59:43.10-05:00", "1:30", "190:20:30", "0o7", "0b1_0", "0x" + "f" * 400, "9" * 5000,
    ".nan", ".inf", "-.inf", "1e400",
    "~", "''", "{}", "[]", "[[]]", "{a: 1}", "[1, 2]", "[[1, 2], [3]]", "{1: 2}", "{[1]: 2}", "? {a: 1}\n: 2", "yes",
    "on", '"\\e[31m"', '"\\x9b31m"',
    '"\\0"', '"\\ud800"', '"a\\nb"', "|\n  a\n  b", "@x", "`x", "%x", "'unclosed", "[unclosed", "{unclosed", "\t- x",
    "#", "---\n---", "...", "a: b: c", "{a, a}",
)  # fmt: skip
"""What may stand where a value does, as text."""


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of every value below one."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, entry in pairs for found in ((*path, key), *places(entry, (*path, key)))]


def held(value: Any, path: tuple[Any, ...]) -> Any:
    """Return what stands at a path."""
    for key in path:
        value = value[key]
    return value


def replaced(rng: np.random.Generator, data: Any) -> None:
    """A value is another, of any type."""
    path = one(rng, places(data) or [()])
    if not path:
        return
    kind, before = rng.random(), held(data, path)
    options: tuple[Any, ...] = (
        TOKEN,
        None,
        True,
        False,
        "",
        [],
        {},
        0,
        -1,
        1,
        1.5,
        [1, 2],
        {"a": 1},
        text(rng),
        float("nan"),
        float("inf"),
    )
    if kind < 0.4:
        new: Any = TOKEN
    elif kind < 0.6 and isinstance(before, (int, float)):
        new = one(rng, (before * 1e300, before * 1e-300, -before, 0, before * 10 ** rng.uniform(-9, 9), 1e160))
        new = float(new)
    elif kind < 0.7 and isinstance(before, list):
        new = one(rng, (before[:-1], before + before, before[::-1], [before], before * 50, [None] * len(before)))
    elif kind < 0.8 and isinstance(before, str):
        new = text(rng)
    else:
        new = one(rng, options)
    held(data, path[:-1])[path[-1]] = new


def keys(rng: np.random.Generator, data: Any) -> None:
    """A key is missing, another, twice there, or there is one more."""
    tables = [path for path in ((), *places(data)) if isinstance(held(data, path), dict) and held(data, path)]
    if not tables:
        return
    table = held(data, one(rng, tables))
    key, kind = one(rng, list(table)), rng.random()
    if kind < 0.45:
        del table[key]
    elif kind < 0.7:
        table[one(rng, (text(rng), 1, 1.5, True, None, TOKEN))] = table.pop(key)
    else:
        table[one(rng, (text(rng), "other", "schema", "kind", "payloads", "urdf", "wish", TOKEN))] = one(
            rng, (1, "x", None, [], {})
        )


def exchanged(rng: np.random.Generator, data: Any) -> None:
    """Two values have changed places; copies of them, or one that stands in two places would come to hold itself."""
    paths = places(data)
    if len(paths) < 2:
        return
    one_path, other = one(rng, paths), one(rng, paths)
    if one_path[: len(other)] == other or other[: len(one_path)] == one_path:
        return
    first, second = deepcopy(held(data, one_path)), deepcopy(held(data, other))
    held(data, one_path[:-1])[one_path[-1]], held(data, other[:-1])[other[-1]] = second, first


MUTATIONS = (replaced, replaced, replaced, keys, exchanged)


def damaged(rng: np.random.Generator, data: bytes) -> bytes:
    """Return YAML with one to three things wrong."""
    tree = yaml.safe_load(data)
    for _ in range(int(rng.integers(1, 4))):
        one(rng, MUTATIONS)(rng, tree)
    written = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, default_flow_style=one(rng, (None, False)))
    written = written.replace(TOKEN, one(rng, RAW))
    if rng.random() < 0.05:
        lines = written.splitlines(keepends=True)
        lines.insert(int(rng.integers(len(lines) + 1)), one(rng, lines or ["a: 1\n"]))
        written = "".join(lines)
    if rng.random() < 0.03:
        written = one(rng, RAW)
    return written.encode("utf-8", errors="surrogatepass")
