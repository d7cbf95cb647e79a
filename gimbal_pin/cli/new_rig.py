"""``gimbal-pin new-rig``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.paths import Reads, list_rig_files
from gimbal_pin.cli.present import say

# The YAML beside a URDF, if it is not there, may be what is to be written.
THERE = Reads(lambda value: filter(Path.exists, list_rig_files(value)))


def new_rig(
    urdf: Annotated[Positional[str], THERE, arg(metavar="URDF")], *, output: opt.MaybeYaml = None
) -> None:
    """Write a commented YAML for a rig: what a URDF cannot say of motors, camera and IMUs, guessed where it can be.

    Args:
        urdf: URDF, xacro, SDF or MJCF, or a bundled rig
    """
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.rig.new_rig import propose_config

    written = propose_config(load_rig(urdf, None), Path.cwd() if output is None else output.parent)
    if output is None:
        say(written[:-1])
        return
    atomic_write(output, written)
    say(f"{output}: edit it, then gimbal-pin check {output}")
