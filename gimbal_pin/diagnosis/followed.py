"""The gain in use: how closely a controller follows with the found causes compensated, and without."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, nan

import numpy as np

from gimbal_pin.control.tracking import Witness, tour
from gimbal_pin.control.tuning import tune
from gimbal_pin.diagnosis.extended import Extended
from gimbal_pin.diagnosis.heldout import massive
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.simulation import Controller, simulate
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Motion

DT = 0.004
"""Sampling interval of the simulated controllers, s."""
BANDWIDTH = 4.0
"""Bandwidth that both are asked for, Hz."""
SIZE = 0.35
"""Angle to each side of the motion, rad, where the limits leave room."""
MOVE = 1.0
"""Duration of each of its moves, s."""
HOW = (
    f"all axes {degrees(SIZE):.0f}° to and fro at once where limits leave room, in moves of {MOVE:g} s, by computed "
    f"torque of {BANDWIDTH:g} Hz on the extended model; neither the log's motion nor its controller"
)
"""Which motion it is, and who follows it: a log's own tracking error is of another."""

WORSE = 1.1
"""Ratio of errors from which it is the controller and not the sensors' noise: 1000 samples tell an rms to 2 %."""
NO_CLOSER = (
    "followed no closer by the controller that knows what was found: what a drive cannot give none makes up for, and "
    "figures that are rough mislead it"
)
"""What is told of joints that are followed worse with compensation."""

Followed = Mapping[str, Mapping[str, float]]


def followed(before: Extended, after: Extended, rng: np.random.Generator) -> Followed:
    """Root mean square of reference less true angle, rad, with the causes compensated and without: joint → figures.

    The plant is the extended model. The motion, to and fro on all axes at once, is the same whatever the log, so that
    no choice has touched it; sensors and their noise are the same for both controllers. A loop that is not stable
    without the compensation has no figure, nor have models whose fitted inertias no body can have.
    """
    plant, seed = after.model, int(rng.integers(2**63))
    reference = tour(plant, DT, SIZE, MOVE)
    if not all(massive(model.rig, reference.q) for model in (before.model, plant)):
        return {}
    laws = [tune(model, bandwidth_hz=BANDWIDTH, dt=DT).controller for model in (before.model, plant)]
    figures = [tracked(plant, law, reference, np.random.default_rng(seed)) for law in laws]
    rows = zip(plant.rig.joints, *(figure.tolist() for figure in figures))
    return {joint: {"rms_before": without, "rms_after": with_} for joint, without, with_ in rows}


def no_closer(tracking: Followed) -> list[str]:
    """Say at which joints the controller that knows what was found follows clearly worse; nothing where none does."""
    worse = [joint for joint, row in tracking.items() if row["rms_after"] > WORSE * row["rms_before"]]
    return [f"{', '.join(worse)}: {NO_CLOSER}"] if worse else []


def tracked(plant: Model, law: Controller, reference: Motion, rng: np.random.Generator) -> Array:
    """Root mean square of reference less true angle, rad, (n,); nan where the loop diverges."""
    witness = Witness.of(plant.rig, law.dt)
    try:
        simulate(plant, law, reference, rng=rng, sensors=witness, name="tracking gain")
    except UsageError:
        return np.full(plant.rig.n, nan)
    return np.sqrt(np.mean(np.square(reference.q - np.array(witness.seen)), axis=0))
