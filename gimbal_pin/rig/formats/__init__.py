"""Rigs in other formats: each is converted to a URDF, which everything else reads.

A format is recognised by the root element, xacro by its suffix, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gimbal_pin.errors import RigError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.formats import mjcf, sdf, xacro_macros
from gimbal_pin.rig.reading import LARGEST_TEXT, read_bytes

_Converted = tuple[str, list[str], list[str]]
"""Text of a URDF, a sentence on each thing that is lost, and paths of the files that were read beside it."""


def convert_to_urdf(path: Path, arguments: Mapping[str, str]) -> _Converted:
    """Return a rig's or payload's file as the text of a URDF.

    `arguments`: of a xacro file.

    Raises:
        RigError: It is no XML of a known format, or cannot be converted.
    """
    text = _read_text(path)
    root = urdf.parse_xml(text, str(path))
    if xacro_macros.is_xacro(root, path):
        return xacro_macros.convert_xacro(path, arguments)
    if root.tag == "sdf":
        return (*sdf.convert_sdf(root, str(path)), [])
    if root.tag == "mujoco":
        return mjcf.convert_mjcf(path)
    if root.tag == "robot":
        return text, [], []
    raise RigError(
        str(path),
        f"starts with <{root.tag}>, not <robot>",
        "give a file in xacro, SDF, MJCF or URDF",
    )


def _read_text(path: Path) -> str:
    """Return a text file's content; `RigError` if it cannot be read."""
    try:
        return read_bytes(path, RigError, LARGEST_TEXT).decode("utf-8")
    except UnicodeDecodeError as error:
        raise RigError(str(path), f"is not text ({error})", "give a text file in UTF-8") from error
