"""``gimbal-pin rigs``, ``check``, ``base`` and ``new-rig``: what a rig is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.options import Json, MaybeYaml, Payload, RigName, optional
from gimbal_pin.cli.paths import Reads, Writes
from gimbal_pin.cli.paths import rigs as files_of_rigs
from gimbal_pin.cli.present import noted, present, say
from gimbal_pin.report import text

Mend = Annotated[
    Path | None,
    Writes(suffixes=(".urdf", ".xml")),
    optional("OUT.urdf", "write the URDF with the nearest inertia that a body can have where one breaks a rule"),
]


def existing(value: str, given: Mapping[str, Any]) -> list[Path]:
    """Return the files of a rig that exist: the YAML beside a URDF may be what is to be written."""
    return [path for path in files_of_rigs(value, given) if path.exists()]


RigFile = Annotated[
    Positional[str], Reads(existing), arg(metavar="URDF", help="URDF, xacro, SDF or MJCF, or a bundled rig")
]


def rigs(*, json: Json = None) -> None:
    """List the bundled rigs and payloads."""
    from gimbal_pin.dynamics.checking import list_bundled

    listed = list_bundled()
    present(text.rigs(listed), listed, json)


def check(rig: RigName, *, payload: Payload = None, mend: Mend = None, json: Json = None) -> None:
    """Validate a rig: tree, axes, limits, inertias, camera frame; say what a log must hold."""
    from gimbal_pin.dynamics.checking import check as run
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.rig.rig import Rig

    loaded = Rig.load(rig, payload, mend=mend is not None)
    if mend is not None:
        atomic_write(mend, loaded.urdf)
        noted([f"{mend} is written: name it as 'urdf:' in the rig's YAML"])
    found = run(loaded)
    present(text.check(found), found.to_dict(), json)


def base(
    rig: RigName,
    *,
    payload: Payload = None,
    diagonal: Annotated[bool, arg(help="diagonal inertias and no masses, as in the thesis")] = False,
    json: Json = None,
) -> None:
    """Base parameters: what the joint torques can show, the regrouping, what they cannot."""
    from gimbal_pin.dynamics.base_parameters import compute_base as run

    found = run(load_rig(rig, payload), diagonal)
    present(text.base(found), found.to_dict(), json)


def new_rig(urdf: RigFile, *, output: MaybeYaml = None) -> None:
    """Write a commented YAML for a rig: what a URDF cannot say of motors, camera and IMUs, guessed where it can be."""
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.rig.new_rig import propose_config

    written = propose_config(load_rig(urdf, None), Path.cwd() if output is None else output.parent)
    if output is None:
        say(written[:-1])
        return
    atomic_write(output, written)
    say(f"{output}: edit it, then gimbal-pin check {output}")
