"""``gimbal-pin demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import describe_origin, describe_run, load_rig
from gimbal_pin.cli.present import present, tell


def demo(
    output: opt.AutoFolder = Path("gimbal-pin-demo"),
    *,
    rig: Annotated[str, opt.RIG_FILES] = "thesis",
    payload: opt.Payload = None,
    seconds: Annotated[float, opt.between("--seconds", 1, 3600, "s")] = 22.0,
    plants: opt.Plants = 50,
    seed: opt.Seed = 0,
    verbose: opt.Verbose = False,
    json: opt.Json = None,
) -> None:
    """Run auto on a simulated log of a rig whose true parameters differ from its URDF; needs nothing.

    Args:
        rig: bundled rig, or its file
        seconds: length of the simulated log
    """
    asked = describe_run("demo", locals())
    origin = describe_origin(demo, locals())
    import numpy as np

    from gimbal_pin.report.pipeline import demo as run
    from gimbal_pin.report.pipeline import describe_outcome

    loaded = load_rig(rig, payload)
    rng = np.random.default_rng(seed)
    found = run(loaded, output, rng=rng, seconds=seconds, run=asked, plants=plants, origin=origin)
    tell(found.notes)
    present(describe_outcome(found, verbose), found.to_dict(), json)
