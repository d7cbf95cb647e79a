"""Names that are code where a page takes them for its own text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath
from xml.sax.saxutils import quoteattr

import numpy as np

from fuzzing.case import Case
from fuzzing.junk import one
from fuzzing.seeds import Seeds

SCRIPTS = (
    "</script><script>alert(1)</script>", "<img src=x onerror=alert(1)>", "<!--<script>", "'><svg onload=alert(1)>",
    "]]>", "</style></svg></title><b>", "&lt<i>", "javascript:alert(1)", "' onmouseover='alert(1)", "${alert(1)}",
    "$<b>$",
)  # fmt: skip
NAMED = ("pan", "arm", "sight", "rig", "block", "camera", "column", "log file", "rig file")
"""Joint, links, rig, payload's links, a column, files."""


def named(seeds: Seeds, names: Mapping[str, str]) -> Seeds:
    """Return the rig, the payload and the log with other names, each written as its format quotes it."""
    urdf, block = seeds["pan.urdf"].decode(), seeds["block.urdf"].decode()
    rig, log = seeds["pan.yaml"].decode(), seeds["log.csv"].decode()
    header, rows = log.split("\n", 1)
    columns = header.split(",")
    if "rig" in names:
        urdf = urdf.replace('<robot name="pan"', f"<robot name={quoteattr(names['rig'])}")
        rig = rig.replace("one joint that tilts", json.dumps(names["rig"]))
    if "pan" in names:
        urdf = urdf.replace('joint name="pan"', f"joint name={quoteattr(names['pan'])}")
        rig = rig.replace("  pan: {", f"  {json.dumps(names['pan'])}: {{")
        columns = [f"{name[:-3]}{names['pan']}" if name.endswith("_pan") else name for name in columns]
    for link in (link for link in ("arm", "sight") if link in names):
        urdf = urdf.replace(f'"{link}"', quoteattr(names[link]))
        rig = rig.replace(f" {link}\n", f" {json.dumps(names[link])}\n").replace(
            f", {link}]", f", {json.dumps(names[link])}]"
        )
    for link in (link for link in ("block", "camera") if link in names):
        block = block.replace(f'"{link}"', quoteattr(names[link]))
    if "column" in names:
        columns[-1] = names["column"]
    header = ",".join('"' + name.replace('"', '""') + '"' for name in columns)
    texts = {"pan.urdf": urdf, "block.urdf": block, "pan.yaml": rig, "log.csv": f"{header}\n{rows}"}
    return {**seeds, **{name: text.encode() for name, text in texts.items()}}


def moved(case: Case, name: str, stem: str) -> Case:
    """Return a case one of whose files has another name."""
    new = stem.replace("/", "\u2215")[:100] + PurePath(name).suffix
    words = tuple(new if word == name else word for word in case.words)
    return replace(case, words=words, inputs={new if key == name else key: x for key, x in case.inputs.items()})


def scripted(rng: np.random.Generator, seeds: Seeds, line: str) -> Case:
    """Return a call that draws a page of names with code in them, and the same with plain names."""
    chosen = [name for name in NAMED if rng.random() < 0.5] or [one(rng, NAMED)]
    names = {name: f"{name} {one(rng, SCRIPTS)}" for name in chosen}

    def call(of: Mapping[str, str]) -> Case:
        files = named(seeds, of)
        wanted = ("pan.yaml", "pan.urdf", "log.csv", *(("block.urdf",) if "block.urdf" in line else ()))
        case = Case(tuple(line.split()), {name: files[name] for name in wanted})
        for file in (name for name in ("log", "rig") if f"{name} file" in of):
            case = moved(case, "log.csv" if file == "log" else "pan.yaml", of[f"{file} file"])
        return case

    return replace(call(names), plain=call({name: f"{name} plain" for name in chosen}))
