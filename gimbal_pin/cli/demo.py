"""``gimbal-pin demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from gimbal_pin.cli.inputs import load_rig, run_of
from gimbal_pin.cli.options import Folder, Json, Payload, Plants, Seed, Verbose, Yes, between
from gimbal_pin.cli.paths import Reads, rigs
from gimbal_pin.cli.present import noted, present
from gimbal_pin.cli.work import affordable
from gimbal_pin.report import text


def demo(
    output: Folder = Path("gimbal-pin-demo"),
    *,
    rig: Annotated[str, Reads(rigs), arg(help="bundled rig")] = "thesis",
    payload: Payload = None,
    seconds: Annotated[float, between("--seconds", 1, 3600, "s"), arg(help="length of the simulated log")] = 22.0,
    plants: Plants = 50,
    seed: Seed = 0,
    yes: Yes = False,
    verbose: Verbose = False,
    json: Json = None,
) -> None:
    """Run auto on a simulated log of a rig whose true parameters differ from its URDF; needs nothing."""
    asked_for = run_of("demo", locals())
    import numpy as np

    from gimbal_pin.report.pipeline import demo as run

    loaded = load_rig(rig, payload)
    affordable(yes, second_of_a_joint_in_a_demo=seconds * loaded.n)
    found = run(loaded, output, rng=np.random.default_rng(seed), seconds=seconds, run=asked_for, plants=plants)
    noted(found.notes)
    present(text.auto(found, verbose), found.to_dict(), json)
