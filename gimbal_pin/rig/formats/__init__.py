"""Rigs in other formats: each is converted to a URDF, which everything else reads.

A format is recognised by the root element, xacro by its suffix, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from lxml import etree

from gimbal_pin.errors import RigError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.formats import mjcf, sdf, xacro_macros
from gimbal_pin.rig.reading import TEXT, read_bytes

Arguments = Mapping[str, str]
Converted = tuple[str, list[str], list[str]]
"""Text of a URDF, a sentence on each thing that is lost, and paths of the files that were read beside it."""


class Format(NamedTuple):
    """A format: whether a file's root element is of it, and what makes a URDF of it."""

    recognises: Callable[[etree._Element, Path], bool]
    convert: Callable[[etree._Element, Path, Arguments], Converted]


FORMATS: Mapping[str, Format] = {
    "xacro": Format(xacro_macros.is_xacro, xacro_macros.convert),
    "SDF": Format(lambda root, path: root.tag == "sdf", lambda root, path, _: (*sdf.convert(root, str(path)), [])),
    "MJCF": Format(lambda root, path: root.tag == "mujoco", lambda root, path, _: mjcf.convert(path)),
    "URDF": Format(lambda root, path: root.tag == "robot", lambda root, path, _: (read(path), [], [])),
}
"""Name → format, in the order in which a file is tried."""


def as_urdf(path: Path, arguments: Arguments) -> Converted:
    """Return a rig's or payload's file as the text of a URDF.

    `arguments`: of a xacro file.

    Raises:
        RigError: It is no XML of a known format, or cannot be converted.
    """
    root = urdf.parse_xml(read(path), str(path))
    for known in FORMATS.values():
        if known.recognises(root, path):
            return known.convert(root, path, arguments)
    raise RigError(str(path), f"starts with <{root.tag}>, not <robot>", f"give a file in {', '.join(FORMATS)}")


def read(path: Path) -> str:
    """Return a text file's content; `RigError` if it cannot be read."""
    try:
        return read_bytes(path, RigError, TEXT).decode("utf-8")
    except UnicodeDecodeError as error:
        raise RigError(str(path), f"is not text ({error})", "give a text file in UTF-8") from error
