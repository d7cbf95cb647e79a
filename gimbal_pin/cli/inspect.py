"""``gimbal-pin inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.options import Json, Logs, optional
from gimbal_pin.cli.paths import Reads, Writes, plot_suffixes, rigs
from gimbal_pin.cli.present import present
from gimbal_pin.errors import UsageError
from gimbal_pin.report import text


def inspect(
    files: Logs,
    *,
    rig: Annotated[
        str | None, Reads(rigs), optional("RIG", "propose a mapping for this rig", "none is proposed")
    ] = None,
    output: Annotated[
        Path | None,
        Writes(chosen=lambda: (".html", *plot_suffixes())),
        arg(aliases=["-o"], metavar="FILE", help="draw every channel: .html, .png, .svg or .pdf"),
    ] = None,
    yaml: Annotated[
        Path | None,
        Writes(suffixes=(".yaml", ".yml")),
        optional("FILE", "write the mapping that is proposed for the first file, to look through and edit"),
    ] = None,
    json: Json = None,
) -> None:
    """What a log's file holds, what each column is and why, and a mapping of columns for a rig."""
    from gimbal_pin.log.io import split_payload
    from gimbal_pin.log.io.files import atomic_write, replacing
    from gimbal_pin.log.io.inspection import inspect as run

    if not files:
        raise UsageError("LOG", "none was given", "name at least one file")
    if yaml is not None and rig is None:
        raise UsageError("--yaml", "is given without a rig", "say with --rig whose joints the columns are of")
    loaded = None if rig is None else load_rig(rig, None)
    found = [run(split_payload(file)[0], loaded) for file in files]
    if yaml is not None:
        atomic_write(yaml, found[0].yaml)
    if output is not None and output.suffix.lower() == ".html":
        from gimbal_pin.report.html import render
        from gimbal_pin.report.sections.data import inspection

        atomic_write(output, render("What the logs hold", [inspection(one) for one in found]))
    elif output is not None:
        from gimbal_pin.report.sections.data import draw

        with replacing(output) as temporary:
            draw(found[0], temporary)
    result = {"schema": 1, "rig": None if loaded is None else loaded.name, "files": [one.to_dict() for one in found]}
    present("\n\n".join(map(text.inspected, found)), result, json)
