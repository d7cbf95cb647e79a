"""How still a camera stands: computed torque beside a PID on a platform that moves, from a rig and a log of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.control.laws import ComputedTorque, JointPid
from gimbal_pin.control.laws.uncertainty import draw_model
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.simulation import plant_with
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import (
    LEARNED,
    WANTED,
    learn_recipe,
    simulate_shaken_log,
    unbalance_payload,
)
from gimbal_pin.pointing.measurement import Station
from gimbal_pin.pointing.result import Verified
from gimbal_pin.pointing.run import Course, run_controllers
from gimbal_pin.pointing.sight import Sight, unable
from gimbal_pin.rig.rig import Rig


def verify(
    rig: Rig,
    *,
    log: Log | None = None,
    plant: Model | None = None,
    known: Model | None = None,
    law: JointPid | ComputedTorque | None = None,
    recorded: Platform | None = None,
    size: float = 1.0,
    causes: Sequence[str] = (),
    seeds: int = 5,
    seconds: float = 30.0,
    jobs: int = 1,
    delay: int = 1,
) -> Verified:
    """Hold the camera with computed torque and with a PID, and measure jitter, drift and torque.

    Args:
        rig: The rig.
        log: The log that teaches model and platform; None: one of 60 s is simulated.
        plant: The plant; None: where a log is given, a rig that it leaves possible, else the rig as its URDF states it,
            its payload 5 mm off the last axis.
        known: The model that the controllers know; None: that of the log.
        law: A law whose gains the controller of its kind has; None: both have loops of one disk margin.
        recorded: Motion of the platform; None: profile S, one per seed.
        size: Profile S times this.
        causes: Causes planted in the plant, as text.
        seeds: Runs of each controller.
        seconds: Length of a run, s; a recorded motion may end it sooner.
        jobs: Processes.
        delay: Samples of 1 ms from measurement to torque.

    Raises:
        UsageError: A rig that cannot hold its camera (see `unable`), a motion that is too short, a loop that diverges.
    """
    if reason := unable(rig, WANTED):
        raise UsageError(
            f"rig {rig.name}",
            f"cannot hold its camera: {reason}",
            "state or change that in its YAML",
        )
    if log is not None and plant is None:
        known = known or identify(rig, [log], holdout="none", examined="never").model
        plant = draw_model(known, np.random.default_rng(LEARNED))
    stood = nominal(unbalance_payload(rig)) if plant is None else plant
    true, drive = plant_with(stood, [parse_effect(text, rig) for text in causes])
    station = Station.of(rig)
    taught = simulate_shaken_log(true, drive) if log is None else log
    recipe = replace(learn_recipe(rig, taught, station, known, delay=delay), law=law)
    if recorded is not None:  # taken for that of the point where the axes meet, as profile S is
        recorded = recorded.about(Sight(rig).centre)
        seconds = min(seconds, float(np.floor(1000 * (recorded.t[-1] - recorded.t[0]) - 1)) / 1000)
    rows = run_controllers(
        Course(true, seconds, station, drive, delay, recorded, size), recipe, seeds, jobs
    )
    loops = {name: recipe.margins(name) for name in recipe.names}
    return Verified(rig, rows, loops)
