"""``gimbal-pin new-rig``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.options import INTO_FILE
from gimbal_pin.cli.paths import Reads, Writes, rigs
from gimbal_pin.cli.present import say

RigFile = Annotated[
    Positional[str], Reads(rigs), arg(metavar="URDF", help="URDF, xacro, SDF or MJCF, or a bundled rig")
]
NewYaml = Annotated[Path | None, Writes(suffixes=(".yaml", ".yml")), INTO_FILE]


def new_rig(urdf: RigFile, *, output: NewYaml = None) -> None:
    """Write a commented YAML for a rig: what a URDF cannot say of motors, camera and IMUs, guessed where it can be."""
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.rig.new_rig import proposed

    text = proposed(load_rig(urdf, None), Path.cwd() if output is None else output.parent)
    if output is None:
        say(text[:-1])
        return
    atomic_write(output, text)
    say(f"{output}: edit it, then gimbal-pin check {output}")
