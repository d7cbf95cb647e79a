"""``gimbal-pin check``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.present import present, tell


def check(
    rig: opt.RigName,
    *,
    payload: opt.Payload = None,
    mend: Annotated[opt.Urdf, arg(metavar="OUT.urdf")] = None,
    json: opt.Json = None,
) -> None:
    """Validate a rig: tree, axes, limits, inertias, camera frame; say what a log must hold.

    Args:
        mend: write the URDF with the nearest inertia that a body can have where one breaks a rule
    """
    from gimbal_pin.dynamics.checking import check as run
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.report.pages import describe_record
    from gimbal_pin.rig.rig import Rig

    loaded = Rig.load(rig, payload, mend=mend is not None)
    if mend is not None:
        atomic_write(mend, loaded.urdf)
        tell([f"{mend} is written: name it as 'urdf:' in the rig's YAML"])
    found = run(loaded)
    present(describe_record(found).to_text(), found.to_dict(), json)
