"""A rig on the bench, simulated: an exciting motion under closed loop, as a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline

from gimbal_pin.control.laws.design import Wish
from gimbal_pin.control.tuning import tune
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.simulation import Controller, Sensors, simulate
from gimbal_pin.effects import Signal
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation import excite
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.inertia import pseudo_inertia
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator


def repeated(motion: Motion, seconds: float, dt: float) -> Motion:
    """Return a motion that starts and ends in one pose, at rest, over and over for `seconds`, sampled every `dt` s."""
    t = dt * np.arange(round(seconds / dt) + 1)
    phase = t % motion.t[-1]
    q, v, a = (
        np.column_stack([np.interp(phase, motion.t, x) for x in getattr(motion, name).T])
        for name in "qva"
    )
    return Motion(t, q, v, a)


def interpolate_motion(motion: Motion, dt: float) -> Motion:
    """Return a motion sampled every `dt` s, by the cubic that has its angles and rates; accelerations are linear."""
    t = motion.t[0] + dt * np.arange(int((motion.t[-1] - motion.t[0]) / dt * (1 + 1e-9)) + 1)
    path = CubicHermiteSpline(motion.t, motion.q, motion.v)
    a = np.column_stack([np.interp(t, motion.t, x) for x in motion.a.T])
    return Motion(t, path(t), path(t, 1), a)


@check_arguments
def bench_run(
    plant: Model,
    controller: Controller | None = None,
    *,
    rng: Rng = None,
    seconds: float = 60.0,
    period: float = 10.0,
    starts: int = 1,
    torque_noise: float = 0.01,
    encoder_bits: float | None = None,
    delay: int = 1,
    reference: Motion | None = None,
    drive: Sequence[Signal] = (),
    platform: Platform | None = None,
    imus: Sequence[str] = (),
    name: str = "simulated",
) -> Log:
    """Simulate an excitation experiment and return its log.

    Args:
        plant: The true rig.
        controller: What moves it; None: computed torque of 4 Hz that knows the plant.
        rng: Source of the excitation's starts and of the sensors' noise, or its seed; None: a fresh one, whose seed is
            in the result.
        seconds: Length, s.
        period: Length of the excitation that is repeated, s.
        starts: Random starts of the excitation's design.
        torque_noise: White noise on the reported torque, as a share of each joint's torque rms.
        encoder_bits: Resolution of the encoders; None: the rig's own.
        delay: Samples between measurement and torque.
        reference: The motion instead of a designed one; interpolated where it has another interval than the controller.
        drive: Signal causes between command and torque, as `plant_with` returns them.
        platform: Motion of the base, see `simulate`; None: it stands.
        imus: Links whose IMU is in the log.
        name: Name of the log.
    """
    mover = (
        tune(plant, bandwidth_hz=4.0, dt=Wish.dt).controller if controller is None else controller
    )
    dt = mover.dt
    rig = plant.rig
    generator, seed = make_generator(rng)
    if reference is None:
        design = excite(
            rig, seconds=period, starts=starts, rng=generator, torque_model=plant, dt=dt
        )
        reference = repeated(design.motion, seconds, dt)
    if len(reference.t) < 2:
        raise UsageError("reference", "has one sample", "give a motion of at least two")
    given = float(np.mean(np.diff(reference.t)))
    notes: tuple[str, ...] = ()
    if not np.allclose(np.diff(reference.t), dt, rtol=1e-6):
        reference = interpolate_motion(reference, dt)
        notes = (
            f"the reference, every {1e3 * given:.4g} ms, is interpolated to the controller's {1e3 * dt:.4g} ms",
        )
    sensors = replace(Sensors.of(rig, dt), imus=tuple(imus))
    if encoder_bits is not None:
        sensors = replace(sensors, encoder_step=np.full(rig.n, 2 * np.pi / 2**encoder_bits))
    log = simulate(
        plant,
        mover,
        reference,
        rng=generator,
        sensors=sensors,
        delay=delay,
        drive=drive,
        platform=platform,
        name=name,
    )
    tau = np.asarray(log.tau)
    noise = torque_noise * np.sqrt(np.mean(tau**2, axis=0)) * generator.standard_normal(tau.shape)
    return replace(log, tau=tau + noise, seed=seed, events=(*notes, *log.events))


def perturbed(rig: Rig, spread: float, rng: np.random.Generator) -> Model:
    """Return a nominal model whose bodies differ from the URDF's by about `spread`, all of them still physical.

    ``P' = (1 + E) P (1 + E)ᵀ`` of every pseudo-inertia, E uniform in ± `spread`/2 except for its last row: masses
    stay, first moments and inertias change. Friction changes by up to ± 3 `spread`.
    """
    phi = [changed(body, spread, rng) for body in np.reshape(rig.phi, (-1, 10))]
    friction = rig.friction * (1 + 3 * spread * rng.uniform(-1, 1, rig.friction.shape))
    return nominal(replace(rig, friction=friction).with_phi(np.concatenate(phi)))


def changed(phi: Array, spread: float, rng: np.random.Generator) -> Array:
    """Return one body's parameters under a random congruence of its pseudo-inertia."""
    E = np.eye(4)
    E[:3, :3] += spread / 2 * rng.uniform(-1, 1, (3, 3))
    return np.array(
        pin.PseudoInertia.FromMatrix(E @ pseudo_inertia(phi) @ E.T).toDynamicParameters()
    )
