"""``gimbal-pin rehearse``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import fix_still_joints, load_rig
from gimbal_pin.cli.present import present


def rehearse(
    rig: opt.RigName,
    motion: Annotated[Positional[str], arg(metavar="MOTION")],
    *,
    payload: opt.Payload = None,
    torque_noise: opt.TorqueNoise = 0.01,
    seed: opt.Seed = 0,
    json: opt.Json = None,
) -> None:
    """Say which causes a log of a motion would show, from which size on, and what each would be taken for.

    Args:
        motion: trajectory file, such as excite's
    """
    from gimbal_pin.diagnosis import rehearse as run
    from gimbal_pin.log.io import read_motion
    from gimbal_pin.log.log import Log
    from gimbal_pin.report.pages import describe_record

    loaded = load_rig(rig, payload)
    planned = read_motion(motion, loaded)
    asked = Log("motion", loaded.joints, planned.t, planned.q, q_ref=planned.q)
    moving, _ = fix_still_joints(loaded, [asked], rig, payload)
    still = [joint for joint in loaded.joints if joint not in moving.joints]
    found = run(
        moving, read_motion(motion, moving), still=still, torque_noise=torque_noise, rng=seed
    )
    present(describe_record(found).to_text(), found.to_dict(), json)
