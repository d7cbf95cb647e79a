"""``gimbal-pin check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from gimbal_pin.cli.options import Json, Payload, RigName, optional
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import noted, present
from gimbal_pin.report import text

Mend = Annotated[
    Path | None,
    Writes(over=(".urdf",)),
    optional("OUT.urdf", "write the URDF with the nearest inertia that a body can have where one breaks a rule"),
]


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
