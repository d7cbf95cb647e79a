"""``gimbal-pin check``."""

from __future__ import annotations

from gimbal_pin import text
from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.options import Json, Payload, RigName
from gimbal_pin.cli.present import present


def check(rig: RigName, *, payload: Payload = None, json: Json = None) -> None:
    """Validate a rig: tree, axes, limits, inertias, camera frame; say what a log must hold."""
    from gimbal_pin.checking import check as run

    found = run(load_rig(rig, payload))
    present(text.check(found), found.to_dict(), json)
