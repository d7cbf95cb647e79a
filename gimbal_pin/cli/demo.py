"""``gimbal-pin demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from gimbal_pin import text
from gimbal_pin.cli.inputs import load_rig, run_of
from gimbal_pin.cli.options import Folder, Json, Payload, Seed
from gimbal_pin.cli.paths import Reads, rigs
from gimbal_pin.cli.present import noted, present


def demo(
    output: Folder = Path("gimbal-pin-demo"),
    *,
    rig: Annotated[str, Reads(rigs), arg(help="bundled rig")] = "thesis",
    payload: Payload = None,
    seconds: Annotated[float, arg(help="length of the simulated log, s")] = 22.0,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Run auto on a simulated log of a rig whose true parameters differ from its URDF; needs nothing."""
    asked_for = run_of("demo", locals())
    import numpy as np

    from gimbal_pin.walk import demo as run

    found = run(load_rig(rig, payload), output, rng=np.random.default_rng(seed), seconds=seconds, run=asked_for)
    noted(found.notes)
    present(text.auto(found), found.to_dict(), json)
