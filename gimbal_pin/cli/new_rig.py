"""``gimbal-pin new-rig``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.paths import Reads, list_rig_files
from gimbal_pin.cli.present import say


def list_existing_files(value: str, given: Mapping[str, Any]) -> list[Path]:
    """Return the files of a rig that exist: the YAML beside a URDF may be what is to be written."""
    return [path for path in list_rig_files(value, given) if path.exists()]


def new_rig(
    urdf: Annotated[
        Positional[str],
        Reads(list_existing_files),
        arg(metavar="URDF", help="URDF, xacro, SDF or MJCF, or a bundled rig"),
    ],
    *,
    output: opt.MaybeYaml = None,
) -> None:
    """Write a commented YAML for a rig: what a URDF cannot say of motors, camera and IMUs, guessed where it can be."""
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.rig.new_rig import propose_config

    written = propose_config(load_rig(urdf, None), Path.cwd() if output is None else output.parent)
    if output is None:
        say(written[:-1])
        return
    atomic_write(output, written)
    say(f"{output}: edit it, then gimbal-pin check {output}")
