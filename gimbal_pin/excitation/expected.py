"""What a log of a planned motion will tell of each parameter, before the motion is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import nan
from typing import Any, ClassVar, Literal

import numpy as np

from gimbal_pin.dynamics.model import Model, build_rotors, build_stated_effects, is_motor_friction
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import Effect
from gimbal_pin.errors import finite_or_none
from gimbal_pin.identification import find_unseen, given_beta
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.regression import (
    FORM_ERROR,
    Design,
    Filtering,
    add_lag_spread,
    compute_blocks,
    fit_lags,
    fit_weighted,
    presume_misfit,
)
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.inertia import join_names
from gimbal_pin.rig.types import Rng, make_generator

WEAK_FROM = 0.5
"""Standard deviation, in shares of a value, from which even its sign is in doubt at two of them."""


@dataclass(frozen=True, eq=False)
class ExpectedEstimate(Record):
    """What `identify` will know from a log of a motion.

    Attributes:
        names: Base parameters, then the effects' coefficients, (k).
        units: Their SI units.
        values: Their values in the model that was planned with, (k,); NaN where it states none.
        std: Standard deviations that `identify` will state, (k,); infinite where the motion leaves no trace.
        unseen: Parameters whose uncertainty alone moves more torque than the whole log has.
        frictionless: Joints of whose friction the model states nothing.
        rate: Samples per second of the log.
        torque_noise: White noise on the reported torques, as a share of each one's rms, (n,).
        form_error: What no rigid body, friction or given effect does, as such a share, (n,).
        sampling: Joint → share of its torque rms that the sampling alone, without any noise, leaves unexplained.
        lag_std: Joint → standard deviation that its torque's lag will have, s; the parameters' hold it.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    std: Array
    unseen: tuple[str, ...]
    frictionless: tuple[str, ...]
    rate: float
    torque_noise: Array
    form_error: Array
    sampling: Mapping[str, float]
    lag_std: Mapping[str, float]

    ROWS: ClassVar[str] = "parameters"
    __repr__ = brief

    @property
    def known(self) -> tuple[Literal["known", "weakly", "not"], ...]:
        """How each is known: `weakly` if its deviation is over half of its value, `not` if it leaves no trace."""
        stated = np.where(np.nan_to_num(self.values) == 0, np.inf, np.abs(self.values))
        weak = self.std > WEAK_FROM * stated
        return tuple(
            "not" if n in self.unseen else "weakly" if w else "known"
            for n, w in zip(self.names, weak)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to change before the motion is run: the log's rate, the motion."""
        said = []
        slow = [
            f"{100 * share:.2g} % of {joint}'s"
            for joint, share in self.sampling.items()
            if share > FORM_ERROR
        ]
        if slow:
            what = f"{self.rate:g} samples per second are too few for this motion: they alone leave {', '.join(slow)}"
            said.append(f"{what} torque unexplained; record faster, or move more slowly")
        if self.frictionless:
            who = f"{join_names(self.frictionless)} {'states' if len(self.frictionless) == 1 else 'state'} no friction"
            said.append(
                f"{who}: with it, all are known less well; state it, or give the model of a first log (--model)"
            )
        if self.unseen:
            every = len(self.unseen) == len(self.names)
            what = (
                "any parameter: make it longer, or record faster"
                if every
                else ", ".join(self.unseen)
            )
            said.append(f"the motion leaves no trace of {what}")
        return tuple(said)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        rows = zip(self.names, self.units, self.values.tolist(), self.std.tolist(), self.known)
        return {
            "rate": self.rate,
            "torque_noise": self.torque_noise.tolist(),
            "form_error": self.form_error.tolist(),
            "lag_std": {joint: finite_or_none(std) for joint, std in self.lag_std.items()},
            "parameters": [
                {
                    "name": name,
                    "unit": unit,
                    "value": finite_or_none(x),
                    "std": finite_or_none(std),
                    "known": known,
                }
                for name, unit, x, std, known in rows
            ],
            "warnings": list(self.warnings),
        }


@limit_to_one_thread()
def predict_estimate(
    model: Model,
    motion: Motion,
    *,
    effects: Sequence[Effect] = (),
    torque_noise: float | None = None,
    form_error: float | None = None,
    rng: Rng = None,
) -> ExpectedEstimate:
    """Return what `identify` will know from a log of a motion, by its own rows, fit and covariance.

    A log with the noise of the rig's sensors is fitted for the deviations, one without for what the sampling leaves.

    Args:
        model: The rig, its encoders, gyros, friction.
        motion: The motion at the log's rate, followed exactly.
        effects: Effects on top of Coulomb and viscous friction.
        torque_noise: White noise on the reported torque, as a share of each joint's torque rms; None: as the model was
            identified with, or 0.01.
        form_error: What no rigid body, friction or given effect does, the same way; or 0.015.
        rng: Source of the sensors' noise, or its seed.
    """
    rig = model.rig
    step = float(np.median(np.diff(motion.t)))
    reduction = reduce_parameters(rig)
    rotors = build_rotors(rig, reduction)
    fitted = (*build_stated_effects(rig, reduction), *effects)
    rubbing = {
        term.effect.joint
        for term in model.terms
        if is_motor_friction(term.effect) and any(term.values)
    }
    values: dict[Effect, tuple[float, ...]] = {
        **{rotor: (rig.motors[rig.joint_index(rotor.joint)].armature,) for rotor in rotors},
        **{term.effect: term.values for term in model.terms},
    }
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a, t=motion.t)
    size = np.maximum(np.sqrt(np.mean(tau**2, axis=0)), 1e-300)
    found = model.estimated
    # The defaults are the medians of `scripts/plants`.
    noise = _choose_shares(
        torque_noise, 0.01, size, found.noise if found else (), np.sqrt(2 * step)
    )
    missed = _choose_shares(form_error, 0.015, size, found.missed if found else ())
    log = record_log(model, motion, noise, make_generator(rng)[0])
    exact = Log("exact", rig.joints, motion.t, motion.q, motion.v, tau)
    design = Design(rig, reduction, fitted, (log,), Filtering(alignment=0.0))
    terms = [x for effect in fitted for x in values.get(effect, (nan,) * len(effect.coefficients))]
    truth = np.concatenate([given_beta(rig, design.reduction), terms])
    blocks = compute_blocks(design)
    if sum(block.b.size for block in blocks) < 3 * len(truth):
        std = np.full(len(truth), np.inf)
        unseen = design.names
        sampling = np.zeros(rig.n)
        late = np.full(rig.n, np.inf)
    else:
        estimate = fit_weighted(blocks)
        group_std = (
            np.array(found.misfit) if found and found.misfit and form_error is None else None
        )
        hedge = partial(presume_misfit, sizes=missed * size, group_std=group_std)
        spread = fit_lags(blocks, np.zeros(rig.n), hedge)[1]
        std = add_lag_spread(blocks, hedge(blocks, estimate), spread).std
        late = np.sqrt(np.diag(spread))
        unseen = find_unseen(design.names, blocks, estimate)
        sampling = fit_weighted(compute_blocks(replace(design, logs=(exact,)))).residual_std / size
    return ExpectedEstimate(
        names=design.names,
        units=design.units,
        values=truth,
        std=std,
        unseen=unseen,
        frictionless=tuple(joint for joint in rig.joints if joint not in rubbing),
        rate=1 / step,
        torque_noise=noise,
        form_error=missed,
        sampling=dict(zip(rig.joints, sampling.tolist())),
        lag_std=dict(zip(rig.joints, late.tolist())),
    )


def _choose_shares(
    stated: float | None,
    otherwise: float,
    size: Array,
    identified: Sequence[float],
    unit: float = 1.0,
) -> Array:
    """Return the stated share for all joints, or what was identified as a share of their torque, or else a default."""
    if stated is None and identified:
        return np.array(identified) / unit / size
    return np.full(len(size), otherwise if stated is None else stated)


def record_log(
    model: Model, motion: Motion, torque_noise: float | Array, rng: np.random.Generator
) -> Log:
    """Return the log of a motion that is followed exactly, with its torque at the sample and the sensors' noise."""
    sensors = Sensors.of(model.rig, float(np.median(np.diff(motion.t))))
    shape = motion.q.shape
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a, t=motion.t)
    tau = tau + torque_noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(shape)
    q = np.stack([sensors.angle(one) for one in motion.q])
    v = motion.v + sensors.rate_std * rng.standard_normal(shape)
    return Log("rehearsal", model.rig.joints, motion.t, q, v, tau)
