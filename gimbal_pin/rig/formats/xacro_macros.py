"""xacro, the macros that ROS packages write URDFs with; needs the package xacro.

Where no ROS installation knows a package that ``$(find PACKAGE)`` names, it is the folder of that name above the file,
or beside one of those above it.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lxml import etree

from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.rig.bounded import ProcessStopped, run_bounded

_NAMESPACE = "ros.org/wiki/xacro"


def is_xacro(root: etree._Element, path: Path) -> bool:
    """Whether there is a macro in a file, or its name says so; a URDF that xacro wrote still names it."""
    if root.tag != "robot":
        return False
    spaced = any(isinstance(e.tag, str) and _NAMESPACE in e.tag for e in root.iter())
    return spaced or path.suffix == ".xacro"


def convert_xacro(path: Path, arguments: Mapping[str, str]) -> tuple[str, list[str], list[str]]:
    """Return the URDF that the macros expand to, with those arguments, no notes, and the files that were read."""
    if find_spec("xacro") is None:
        mend = "install it (pip install 'gimbal_pin[xacro]'), or expand the file to a URDF"
        raise UsageError(str(path), "is a xacro file, which needs the package xacro", mend)
    try:
        found = run_bounded(__name__, str(path.resolve()), json.dumps(dict(arguments)))
        return found["text"], [], found["files"]
    except ProcessStopped as error:
        mend = "mend it; arguments are given in the rig's YAML (xacro: {prefix: left_})"
        raise RigError(
            str(path), f"is a xacro file that does not expand ({error})", mend
        ) from error


def main(path: str, arguments: str) -> dict[str, Any]:
    """Expand a file, in a process that has bounds: macros may call themselves for ever; it reads regular files only."""
    import xacro
    from xacro import substitution_args

    known = substitution_args._eval_find

    def find(package: str) -> str:
        folders = (above / own for above in Path(path).parents for own in ("", package))
        try:
            return str(known(package))
        except ImportError:
            found = next(
                (folder for folder in folders if folder.name == package and folder.is_dir()), None
            )
            if found is None:
                raise xacro.XacroException(
                    f"no folder '{package}' above the file or beside one of them"
                ) from None
            return str(found)

    def record_opened(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[0], str):
            if Path(given[0]).exists() and not Path(given[0]).is_file():
                raise xacro.XacroException(f"{given[0]} is no regular file")
            files.append(os.path.abspath(given[0]))

    files: list[str] = []
    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
    sys.addaudithook(
        record_opened
    )  # files that macros include, load as YAML, or name by an argument
    text = str(xacro.process_file(path, mappings=json.loads(arguments)).toxml())
    return {"text": text, "files": list(dict.fromkeys(files))}
