"""Noise in the regressor: parameters that walk with the filter's cutoff, and what they are in spite of it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from gimbal_pin.diagnosis.audit.base import MATERIAL, Fault, stated
from gimbal_pin.diagnosis.audit.probe import Probe, probe, rows_at
from gimbal_pin.estimators.base import Estimate
from gimbal_pin.estimators.instrumental import instrumental, repeated
from gimbal_pin.estimators.weighted import weighted
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Block, Filtering, Flags

PARTS = 12
"""Parts of the log that the jackknife leaves out in turn."""
SIGNIFICANT = 2.5
"""Deviations that a change must have."""
NEAR, FAR = 2.0, 4.0
"""Cutoffs of the sweep, in multiples of the default: FAR is half the smoother's bandwidth."""
LOST = 0.2
"""Share of the inertia that must be lost at FAR: less is what delay, lag and cogging do, too."""
WALKED = 0.1
"""Change of the torque that the parameters at FAR make, as a share of its rms, to be worth a note."""
MARGIN = 2.0 * MATERIAL
"""Change of the torque at NEAR, as a share of its rms, from which the default cutoff is not safe either."""
FOLLOWS = 0.2
"""A joint follows its reference if the difference is under this share of the reference's spread."""


class Change(NamedTuple):
    """What other parameters change, on the rows at the default cutoff, per joint (n,).

    Attributes:
        torque: Rms of the change in predicted torque, as a share of the torque's rms.
        loss: Share of the inertial torque that is lost.
        std: Standard deviation of `loss`.
    """

    torque: Array
    loss: Array
    std: Array

    @property
    def significant(self) -> Flags:
        """Joints that lose inertia beyond chance, (n,)."""
        return np.asarray(self.loss > SIGNIFICANT * self.std)


class Jackknife(NamedTuple):
    """Parameters from all parts, (k,), and with each part left out, (PARTS, k)."""

    theta: Array
    left_out: Array


@dataclass(frozen=True)
class AccelerationNoise:
    """``A = A(true motion) + noise``: least squares then shrinks towards zero what multiplies the acceleration.

    Two tests. Raising the cutoff lets more noise in: do the parameters walk, and does the inertia fall? And at the
    default cutoff: do even and odd samples as each other's instruments (`repeated`) say something else than least
    squares (Durbin, Wu and Hausman)? Both halves saw the same motion, so a wrong model changes both alike, and only
    noise makes the difference.
    """

    name: ClassVar[str] = "acceleration-noise"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("angle", 0.02, "rad", 0.0, 1.0),
        Parameter("rate", 1.0, "rad/s", 0.0, 100.0),
    )

    def examine(self, rig: Rig, log: Log) -> Fault | None:
        """Return the fault if the noise is material; `answer` holds the estimate by instrumental variables."""
        made = probe(rig, log)
        cutoff = Filtering().cutoff
        rows = rows_at(made, cutoff)
        if sum(block.b.size for block in rows) < 3 * len(made.names) or not rows:
            return None
        halves = probe(rig, log, made, 0), probe(rig, log, made, 1)
        near, far = swept(made, cutoff)
        bias, drowned = hausman(made, halves, cutoff), noise_share(halves, cutoff) > LOST
        here = drowned | (bias.torque > MATERIAL) & bias.significant
        walks = (far.torque > WALKED) & (far.loss > LOST) & far.significant
        if not np.any(here | walks):
            return None
        worst = int(np.argmax(np.where(here | walks, far.loss, -np.inf)))
        serious = bool(np.any(here | walks & (near.torque > MARGIN)))
        return told(rig, made, worst, serious, (near, far, bias), answered(rig, log, made, halves))

    def corrupt(self, log: Log, rng: np.random.Generator, **shape: float) -> Log:
        """Add white noise to the angles and the rates."""
        size = stated(self, shape)
        q = log.q + size["angle"] * rng.standard_normal(log.q.shape)
        v = None if log.v is None else log.v + size["rate"] * rng.standard_normal(log.q.shape)
        return replace(log, q=q, v=v)


def noise_share(halves: tuple[Probe, Probe], cutoff: float) -> Array:
    """Return the share of the acceleration columns' power in which even and odd samples differ, per joint, (n,)."""
    even, odd = (np.concatenate([block.A for block in rows_at(x, cutoff, inertial=True)]) for x in halves)
    difference, mean = (np.sum(x**2, axis=(0, 2)) for x in ((even - odd) / 2, (even + odd) / 2))
    return np.asarray(difference / np.maximum(mean, 1e-300))


def answered(rig: Rig, log: Log, made: Probe, halves: tuple[Probe, Probe]) -> Estimate:
    """Return the estimate by instrumental variables at the default cutoff.

    The reference's own columns are the instruments where the log holds a reference and the joints follow it: it knows
    nothing of the sensors' noise, coloured or not. Else each half of the samples is the other's.
    """
    cutoff = Filtering().cutoff
    if log.q_ref is not None and np.all(np.std(log.q - log.q_ref, axis=0) <= FOLLOWS * np.std(log.q_ref, axis=0)):
        wished = probe(rig, replace(log, q=log.q_ref, v=None), made)
        return instrumental(rows_at(made, cutoff), [block.A for block in rows_at(wished, cutoff)])
    return repeated(*(rows_at(half, cutoff) for half in halves))


def weights(rows: Sequence[Block]) -> Array:
    """One over the power of each joint's residual, (n,)."""
    power = weighted(rows).residual_std ** 2
    return np.asarray(1.0 / np.maximum(power, 1e-6 * power.max() + 1e-300))


def swept(made: Probe, cutoff: float) -> tuple[Change, Change]:
    """Return what the parameters at NEAR and at FAR times the cutoff change against those at the cutoff."""
    rows = rows_at(made, cutoff)
    weight = weights(rows)
    first = jackknife([(block.A, block.A, block.b) for block in rows], weight)
    inertial = rows_at(made, cutoff, inertial=True)
    changes = []
    for factor in (NEAR, FAR):
        other = [(block.A, block.A, block.b) for block in rows_at(made, factor * cutoff)]
        changes.append(change(rows, inertial, first, jackknife(other, weight)))
    return changes[0], changes[1]


def hausman(made: Probe, halves: tuple[Probe, Probe], cutoff: float) -> Change:
    """Return what least squares changes against instrumental variables at the same cutoff."""
    rows, even, odd = (rows_at(x, cutoff) for x in (made, *halves))
    weight = weights(rows)
    crossed = [(x.A, y.A, x.b) for x, y in zip(even, odd)] + [(y.A, x.A, x.b) for x, y in zip(even, odd)]
    plain = [((x.A + y.A) / 2, (x.A + y.A) / 2, x.b) for x, y in zip(even, odd)]
    inertial = rows_at(made, cutoff, inertial=True)
    return change(rows, inertial, jackknife(crossed, weight), jackknife(plain, weight))


def jackknife(rows: Sequence[tuple[Array, Array, Array]], weight: Array) -> Jackknife:
    """Solve ``ZᵀWA theta = ZᵀWb`` for rows (Z, A, b), from all of them and with each part left out in turn."""
    moments, targets = np.zeros((2, PARTS)).astype(object)
    for Z, A, b in rows:
        edges = np.linspace(0, len(b), PARTS + 1).astype(int)
        for i, (begin, end) in enumerate(itertools.pairwise(edges)):
            part = slice(begin, end)
            moments[i] = moments[i] + np.einsum("tjk,j,tjl->kl", Z[part], weight, A[part], optimize=True)
            targets[i] = targets[i] + np.einsum("tjk,j,tj->k", Z[part], weight, b[part])
    moment, target = moments.sum(), targets.sum()
    unit = np.sqrt(np.maximum(np.abs(np.diag(moment)), 1e-300))

    def solved(lhs: Array, rhs: Array) -> Array:
        return np.asarray(np.linalg.lstsq(lhs / np.outer(unit, unit), rhs / unit, rcond=1e-12)[0] / unit)

    return Jackknife(
        solved(moment, target), np.stack([solved(moment - m, target - g) for m, g in zip(moments, targets)])
    )


def change(rows: Sequence[Block], inertial: Sequence[Block], first: Jackknife, second: Jackknife) -> Change:
    """Return what the second parameters change against the first, on these rows."""
    A, Ia, b = (np.concatenate(x) for x in zip(*((x.A, y.A, x.b) for x, y in zip(rows, inertial))))
    width = Ia.shape[2]
    power = np.mean(b**2, axis=0)
    moves = power > 1e-6 * power.max()
    torque = np.sqrt(np.mean((A @ (second.theta - first.theta)) ** 2, axis=0) / np.where(moves, power, np.inf))
    own = Ia @ first.theta[:width]
    size = np.maximum(np.sum(own**2, axis=0), 1e-300)
    # (K, n): the inertial torque's projection on what it was.
    shares = np.einsum("tj,tjk->jk", own, Ia) / size[:, None]
    loss = -shares @ (second.theta - first.theta)[:width]
    parts = -(second.left_out - first.left_out)[:, :width] @ shares.T
    std = np.sqrt((PARTS - 1) / PARTS * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0))
    return Change(torque, loss, std)


def told(
    rig: Rig, made: Probe, worst: int, serious: bool, changes: tuple[Change, Change, Change], answer: Estimate
) -> Fault:
    """Return the fault with its figures and what to do."""
    near, far, bias = changes
    cutoff, joint = Filtering().cutoff, rig.joints[worst]
    severity = (
        Parameter("inertia_lost", float(far.loss[worst]), "1", std=float(far.std[worst])),
        Parameter("walk_near", float(near.torque[worst]), "1"),
        Parameter("walk_far", float(far.torque[worst]), "1"),
        Parameter("bias", float(bias.torque[worst]), "1"),
        Parameter("cutoff", cutoff, "Hz"),
    )
    sentence = (
        f"{joint}: the acceleration is too noisy: with the filter at {FAR * cutoff:g} Hz instead of {cutoff:g} Hz, "
        f"{100 * far.loss[worst]:.0f} % of the inertia is lost and the torque changes by "
        f"{100 * far.torque[worst]:.0f} %; "
        + ("this is noise in the measured motion, no physics" if serious else f"at {cutoff:g} Hz it does no harm")
    )
    mend = (
        "record with a finer encoder or a gyro, faster motion, and at least 30 s; use the estimate by instrumental "
        "variables until then"
    )
    values = zip(made.names, answer.theta.tolist(), made.units, answer.std.tolist())
    estimated = tuple(Parameter(name, value, unit, std=std) for name, value, unit, std in values)
    return Fault(AccelerationNoise.name, joint, severity, serious, sentence, mend, answer=estimated)
