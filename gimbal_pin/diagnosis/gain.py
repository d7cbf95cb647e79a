"""What the extended model gains: prediction and rollout of unseen data, tracking, and the residual over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, nan

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d

from gimbal_pin.control.tracking import Witness, tour
from gimbal_pin.control.tuning import tune
from gimbal_pin.diagnosis.band import BAND
from gimbal_pin.diagnosis.evidence import Evidence, Part, gather
from gimbal_pin.diagnosis.extended import Extended
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.plant import Plant, State
from gimbal_pin.dynamics.simulation import Controller, simulate
from gimbal_pin.errors import UsageError
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig

Figures = Mapping[str, Mapping[str, float]]
"""Name of a figure → joint → its value."""
CONFIRMED = 1.01
"""Error of the torque without a cause over that with it, from which the held-out part confirms the cause."""
HORIZON = 0.2
"""Length of a rollout, s."""
STARTS = 24
"""Rollouts, and at least one of each part: a mean square of so many is known to a third."""
POSES = 16
"""Poses at which a model's mass matrix is looked at."""
FINE = 2e-3
"""Longest step of a rollout, s."""
DT = 0.004
"""Sampling interval of the simulated controllers, s."""
BANDWIDTH = 4.0
"""Bandwidth that both are asked for, Hz."""
SIZE = 0.35
"""Angle to each side of the motion, rad, where the limits leave room."""
MOVE = 1.0
"""Duration of each of its moves, s."""
WORSE = 1.1
"""Ratio of errors from which it is the controller and not the sensors' noise: 1000 samples tell an rms to 2 %."""
NO_CLOSER = (
    "followed no closer by the controller that knows what was found: what a drive cannot give none makes up for, and "
    "figures that are rough mislead it"
)
"""What is told of joints that are followed worse with compensation."""
Followed = Mapping[str, Mapping[str, float]]
FULL = 0.1
"""Residual, as a share of the joint's torque rms, at which a joint is all red."""
WINDOW = 0.3
"""Time over which the residual's size is taken, s."""
LEAST = 0.1
"""Share of the window in which the joint has to move for its residual to count whole."""


def describe_motion(rig: Rig) -> str:
    """Say which motion it is, and who follows it: a log's own tracking error is of another."""
    sizes = dict.fromkeys(f"{1e3 * SIZE:.0f} mm" if slides else f"{degrees(SIZE):.0f}°" for slides in rig.slides)
    return (
        f"all axes {' or '.join(sizes)} to and fro at once where limits leave room, in moves of {MOVE:g} s, by "
        f"computed torque of {BANDWIDTH:g} Hz on the extended model; neither the log's motion nor its controller"
    )


def measured(held: Evidence, model: Extended) -> Figures:
    """Held-out figures of a model, by joint."""
    joints, rmse = held.rig.joints, torque_rmse(held, model)
    fit = 100 * (1 - rmse / np.maximum(torque_rms(held), 1e-300))
    rolled = rollout_rmse(held, model)
    rows = {"torque_rmse": rmse, "fit_percent": fit, "rollout_rmse": rolled}
    return {name: dict(zip(joints, values.tolist())) for name, values in rows.items()}


def torque_rmse(evidence: Evidence, model: Extended) -> Array:
    """Root mean square of measured less predicted torque, low-passed at the band, away from standstill, N m, (n,)."""
    return np.sqrt(compute_gated_power(evidence, compute_filtered_error(evidence, model)))


def torque_rms(evidence: Evidence) -> Array:
    """Root mean square of the measured torque less its mean, over the same samples, N m, (n,)."""
    mean = np.mean(np.concatenate(evidence.torque), axis=0)
    swing = [filter_torque(part, part.channels.tau - mean, evidence.band) for part in evidence.parts]
    return np.sqrt(compute_gated_power(evidence, np.concatenate(swing)))


def compute_gated_power(evidence: Evidence, error: Array) -> Array:
    """Mean square of a gated error over the samples that count, (N m)², (n,): an error of one gives one."""
    counted = np.concatenate([filter_torque(part, np.ones((1, 1)), evidence.band) for part in evidence.parts])
    weight = np.sum(counted**2, axis=0)
    return np.sum(error**2, axis=0) / np.maximum(weight, 1e-300)


def compute_filtered_error(evidence: Evidence, model: Extended) -> Array:
    """Measured less predicted torque, gated and low-passed at the band, all parts in a row, N m, (m, n)."""
    return np.concatenate(
        [filter_torque(part, compute_torque_error(part, model), evidence.band) for part in evidence.parts]
    )


def filter_torque(part: Part, torque: Array, band: float) -> Array:
    """Gate a torque and low-pass it at the band, N m, (m, n)."""
    return signals.zero_phase(part.gate * torque, signals.lowpass(band, 1 / part.dt))


def compute_torque_error(part: Part, model: Extended) -> Array:
    """Acting torque less what the model asks for the same motion, N m, (m, n)."""
    c = part.channels
    wanted = model.model.inverse(c.q, c.v, c.a, part.slide, part.time, part.temperature, c.platform, part.losses)
    return model.acting(part) - wanted


def rollout_rmse(evidence: Evidence, model: Extended) -> Array:
    """Simulated less measured angle after `HORIZON` s of the logged torque, from measured states, rad rms, (n,).

    What friction remembers at a start comes from the measured way to it, and it is as warm as the motor was. nan where
    no stretch is long enough, or where the fitted inertias are none that a body can have, as on slow motion that does
    not show them: such a model cannot be simulated, and that it cannot says nothing about its other torques.
    """
    errors = []
    if not all(is_massive(model.model.rig, part.channels.q) for part in evidence.parts):
        return np.full(evidence.rig.n, np.nan)
    for part in evidence.parts:
        plant = Plant(model.model, model.model.carried(part.time, part.platform))
        horizon = max(1, round(HORIZON / part.dt))
        tau = model.acting(part)
        memory = plant.friction.remembered(part.sample)
        for start in choose_starts(part, horizon, -(-STARTS // len(evidence.parts))):
            held = tuple(one[..., start].tolist() for one in memory)
            state = State(part.channels.q[start], part.channels.v[start], held)
            plant.friction.warm = part.temperature[start].tolist()
            end = roll_out(plant, part, tau, start, state, horizon)
            errors.append(end - part.channels.q[start + horizon])
    return np.sqrt(np.mean(np.square(errors), axis=0)) if errors else np.full(evidence.rig.n, np.nan)


def is_massive(rig: Rig, q: Array) -> bool:
    """Whether the mass matrix is positive definite at some of the angles q, (m, n)."""
    data = rig.model.createData()
    some = q[:: max(1, len(q) // POSES)]
    least = [np.linalg.eigvalsh(pin.crba(rig.model, data, angles), UPLO="U")[0] for angles in some]
    return min(least) > 0.0


def choose_starts(part: Part, horizon: int, most: int) -> Sequence[int]:
    """As many samples to start from, evenly spread, clear of the ends and of holes: there nobody knows the torque."""
    edge = len(part.gate) // 20
    free = np.arange(edge, len(part.gate) - edge - horizon + 1)
    if part.channels.lost is not None:
        before = np.concatenate([[0], np.cumsum(part.channels.lost)])
        free = free[before[free + horizon + 1] == before[free]]
    return [] if not len(free) else free[np.linspace(0, len(free) - 1, most).astype(int)].tolist()


def roll_out(plant: Plant, part: Part, tau: Array, start: int, state: State, horizon: int) -> Array:
    """Angles after a rollout from a state at sample `start`, rad, (n,)."""
    steps, time = max(1, round(part.dt / FINE)), part.time
    for k in range(start, start + horizon):
        torque = (tau[k] + tau[k + 1]) / 2
        for i in range(steps):
            state = plant.step(time[k] + i * part.dt / steps, state, torque, part.dt / steps)
    return state.q


def followed(before: Extended, after: Extended, rng: np.random.Generator) -> Followed:
    """Root mean square of reference less true angle, rad, with the causes compensated and without: joint → figures.

    The plant is the extended model. The motion, to and fro on all axes at once, is the same whatever the log, so that
    no choice has touched it; sensors and their noise are the same for both controllers. A loop that is not stable
    without the compensation has no figure, nor have models whose fitted inertias no body can have.
    """
    plant, seed = after.model, int(rng.integers(2**63))
    reference = tour(plant, DT, SIZE, MOVE)
    if not all(is_massive(model.rig, reference.q) for model in (before.model, plant)):
        return {}
    laws = [tune(model, bandwidth_hz=BANDWIDTH, dt=DT).controller for model in (before.model, plant)]
    figures = [measure_tracking(plant, law, reference, np.random.default_rng(seed)) for law in laws]
    rows = zip(plant.rig.joints, *(figure.tolist() for figure in figures))
    return {joint: {"rms_before": without, "rms_after": with_} for joint, without, with_ in rows}


def no_closer(tracking: Followed) -> list[str]:
    """Say at which joints the controller that knows what was found follows clearly worse; nothing where none does."""
    worse = [joint for joint, row in tracking.items() if row["rms_after"] > WORSE * row["rms_before"]]
    return [f"{', '.join(worse)}: {NO_CLOSER}"] if worse else []


def measure_tracking(plant: Model, law: Controller, reference: Motion, rng: np.random.Generator) -> Array:
    """Root mean square of reference less true angle, rad, (n,); nan where the loop diverges."""
    witness = Witness.of(plant.rig, law.dt)
    try:
        simulate(plant, law, reference, rng=rng, sensors=witness, name="tracking gain")
    except UsageError:
        return np.full(plant.rig.n, nan)
    return np.sqrt(np.mean(np.square(reference.q - np.array(witness.seen)), axis=0))


def heat(model: Model, log: Log, filtering: Filtering = BAND) -> Array:
    """``min(1, rms(tau - model) / (FULL rms(tau)))``, one value per sample and joint of the log, (N, n).

    The residual is low-passed at the filtering's cutoff; its size is that over `WINDOW` around each sample, where the
    joint moves: as it stands, dry friction bears any torque. Samples in gaps count as the nearest.

    Args:
        model: The model, with drives and terms, of a rig with the log's joints.
        log: The log, with torques.
        filtering: As for `diagnose`.

    Raises:
        DataError: The log is too short to be judged.
        UsageError: It holds no torque.
    """
    evidence = gather(model.rig, [log], filtering)
    torque = np.sqrt(np.mean(np.concatenate(evidence.torque) ** 2, axis=0))
    times, sizes = [], []
    for part in evidence.parts:
        error = filter_torque(part, compute_torque_error(part, Extended(model)), evidence.band)
        window = max(1, round(WINDOW / part.dt))
        power, moving = (uniform_filter1d(x**2, window, axis=0, mode="constant") for x in (error, part.gate))
        power /= np.maximum(moving, LEAST)
        times.append(part.channels.t)
        sizes.append(np.sqrt(np.maximum(power, 0.0)) / np.maximum(FULL * torque, 1e-300))
    t, size = np.concatenate(times), np.concatenate(sizes)
    return np.clip(np.stack([np.interp(log.t, t, column) for column in size.T], axis=1), 0.0, 1.0)
