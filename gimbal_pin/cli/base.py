"""``gimbal-pin base``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import arg

from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.options import Json, Payload, RigName
from gimbal_pin.cli.present import present
from gimbal_pin.report import text


def base(
    rig: RigName,
    *,
    payload: Payload = None,
    diagonal: Annotated[bool, arg(help="diagonal inertias and no masses, as in the thesis")] = False,
    json: Json = None,
) -> None:
    """Base parameters: what the joint torques can show, the regrouping, what they cannot."""
    from gimbal_pin.dynamics.base_parameters import base as run

    found = run(load_rig(rig, payload), diagonal)
    present(text.base(found), found.to_dict(), json)
