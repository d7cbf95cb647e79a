"""``gimbal-pin base``."""

from __future__ import annotations

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import load_rig
from gimbal_pin.cli.present import present


def base(
    rig: opt.RigName, *, payload: opt.Payload = None, diagonal: bool = False, json: opt.Json = None
) -> None:
    """Base parameters: what the joint torques can show, the regrouping, what they cannot.

    Args:
        diagonal: diagonal inertias and no masses, as in the thesis
    """
    from gimbal_pin.dynamics.base_parameters import compute_base
    from gimbal_pin.report.pages import describe_record

    found = compute_base(load_rig(rig, payload), diagonal)
    present(describe_record(found).to_text(), found.to_dict(), json)
