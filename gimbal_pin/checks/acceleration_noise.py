"""Noise in the regressor: accelerations drowned in the sensors' noise, and parameters in spite of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gimbal_pin.checks.harm import MATERIAL, build_design
from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.checks.series import estimate_angle_noise, estimate_local_noise, find_step
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Block,
    Design,
    Estimate,
    Filtering,
    Segment,
    fit_instrumental,
    fit_repeated,
    fit_weighted,
    smooth_samples,
    split_segments,
)
from gimbal_pin.rig.rig import Rig

DROWNED = 0.6
"""Noise of the smoothed acceleration, as a multiple of the motion's rms below the cutoff, that is worth telling."""
JUDGED_PARTS = 24
"""Parts of the log, the worst of which is judged."""
NEAR_CUTOFF, FAR_CUTOFF = 2.0, 4.0
"""Cutoffs of the sweep, in multiples of the given one."""
SAFE, WALKED = 0.02, 0.1
"""Change of the torque at NEAR and at FAR, as a share of its rms, from which the given cutoff is not safe either."""
FOLLOWS = 0.2
"""A joint follows its reference if the difference is under this share of the reference's spread."""


def check_acceleration_noise(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``A = A(true motion) + noise``: least squares then shrinks towards zero what multiplies the acceleration.

    The sensors' noise says whether the acceleration drowns. Whether that harms the fit, two tests say. At the given
    cutoff: do even and odd samples as each other's instruments (`repeated`) say something else than least squares
    (Durbin, Wu and Hausman)? Both halves saw the same motion, so a wrong model changes both alike, and only noise makes
    the difference. And at twice the cutoff, which lets more of the noise in: do the parameters walk? Both are asked of
    the torque at the joints whose acceleration drowns, and beyond what the torque's own noise does.
    """
    drowned = compute_noise_share(log, filtering)
    if drowned is None or drowned.max() < DROWNED:
        return None
    made = build_design(rig, log, filtering)
    rows = list(made)
    if not rows or sum(block.b.size for block in rows) < 3 * len(made.names):
        return None
    halves = [list(made.iterate_blocks(partial(take_half, first=first))) for first in (0, 1)]
    crossed = fit_repeated(*halves)
    middle = [a._replace(A=(a.A + b.A) / 2) for a, b in zip(*halves)]
    first = fit_weighted(rows)
    wider = (fit_weighted(list(widen_cutoff(made, factor))) for factor in (NEAR_CUTOFF, FAR_CUTOFF))
    pairs = ((crossed, fit_weighted(middle)), *((first, one) for one in wider))
    bias, near, far = (float(compute_change(rows, *pair)[drowned >= DROWNED].max()) for pair in pairs)
    share, worst, cutoff = float(drowned.max()), int(np.argmax(drowned)), filtering.cutoff
    figures = (
        Parameter("noise_share", share, "1"),
        Parameter("bias", bias, "1"),
        Parameter("walk_near", near, "1"),
        Parameter("walk_far", far, "1"),
        Parameter("cutoff", cutoff, "Hz"),
    )
    answer, step, cause = estimate_answer(log, made, rows, crossed), find_step(log.q[:, worst]), "acceleration-noise"
    bits = np.log2(2 * np.pi / step) if step else 0.0
    coarse = f" (encoder steps of {digits(1000 * step, 2)} mrad, {bits:.0f} bits per turn)" if step else ""
    unreliable = bias > MATERIAL or near > SAFE or far > WALKED
    end = f"at {cutoff:g} Hz it does no harm"
    if unreliable:
        end = (
            f"parameters walk with the filter: {digits(100 * near, 2)} % of the torque from {cutoff:g} to "
            f"{NEAR_CUTOFF * cutoff:g} Hz, {digits(100 * far, 2)} % to {FAR_CUTOFF * cutoff:g} Hz; this is noise in "
            f"the motion, no physics"
        )
    joint = rig.joints[worst]
    sentence = f"{joint}: noise is {digits(share, 2)} times the motion's own acceleration{coarse}; {end}"
    mend = (
        "record with a finer encoder or a gyro, faster motion, and at least 30 s; use the estimate by instrumental "
        "variables until then"
    )
    strength, slight = share / DROWNED, not unreliable
    return Examined(Fault(cause, joint, sentence, figures, strength, unreliable, mend, answer, slight=slight))


def take_half(segment: Segment, first: int) -> Segment:
    """Return a segment's grid over every second sample of its log: the halves' white noise is independent."""
    log = segment.log.part(slice(segment.rows.start + first, segment.rows.stop, 2))
    return segment._replace(log=log, rows=slice(0, len(log)))


def widen_cutoff(design: Design, factor: float) -> Design:
    """Return a design of the same smooth channels with the rows' cutoff so many times as high."""
    now = design.filtering
    direction = None if now.direction is None else now.direction / factor
    wider = replace(now, cutoff=factor * now.cutoff, smoothing=now.smoothing / factor, direction=direction)
    return replace(design, filtering=wider)


def compute_noise_share(log: Log, filtering: Filtering) -> Array | None:
    """Noise of the smoothed acceleration in the worst part, over the motion's acceleration, (n,); None without any.

    From the angle's noise or, where there is one, the rate's, by whichever says less.
    """
    long = [part for part in split_segments(log, filtering.cutoff) if part.dt * part.length > 1.0 / filtering.cutoff]
    if not long or len(log) < 8 * JUDGED_PARTS:
        return None
    rate, smoothing = 1.0 / log.dt, filtering.cutoff * filtering.smoothing
    slow = signals.lowpass(filtering.cutoff, rate)
    a = [signals.zero_phase(smooth_samples(part, filtering, 0, part.length).a, slow) for part in long]
    size = np.maximum(np.std(np.concatenate(a), axis=0), 1e-300)
    sections = signals.lowpass(smoothing, rate)
    once, twice = (signals.compute_noise_gain(sections, rate, derivatives) for derivatives in (1, 2))
    noise = twice * estimate_angle_noise(log, estimate_local_noise(log.t, log.q, JUDGED_PARTS))
    if log.v is not None:
        noise = np.minimum(noise, once * estimate_local_noise(log.t, log.v, JUDGED_PARTS))
    return np.asarray(np.where(np.ptp(log.q, axis=0) > 0, noise.max(axis=0) / size, 0.0))


def compute_change(rows: Sequence[Block], first: Estimate, second: Estimate) -> Array:
    """Return what the second parameters change in each joint's torque in these rows, as a share of its rms, (n,).

    ``√(max(‖A Δθ‖² - tr A C Aᵀ, 0)/‖b‖²)``, C the first's covariance: the torque's noise moves them by as much.
    """
    A, b = np.concatenate([block.A for block in rows]), np.concatenate([block.b for block in rows])
    known = np.where(np.isfinite(first.covariance), first.covariance, 0.0)
    expected = np.mean(np.sum((A @ known) * A, axis=2), axis=0)
    moved, power = np.mean((A @ (second.theta - first.theta)) ** 2, axis=0), np.mean(b**2, axis=0)
    felt = np.where(power > 1e-6 * power.max(), power, np.inf)
    return np.asarray(np.sqrt(np.maximum(moved - expected, 0.0) / felt))


def estimate_answer(log: Log, made: Design, rows: Sequence[Block], crossed: Estimate) -> tuple[Parameter, ...]:
    """Return base parameters and friction by instrumental variables, at the given cutoff.

    The reference's own columns are the instruments where the log holds a reference and the joints follow it: it knows
    nothing of the sensors' noise, coloured or not. Else each half of the samples is the other's: `crossed`.
    """
    found = crossed
    if log.q_ref is not None and np.all(np.std(log.q - log.q_ref, axis=0) <= FOLLOWS * np.std(log.q_ref, axis=0)):
        found = fit_instrumental(rows, [block.A for block in made.iterate_blocks(take_reference)])
    values = zip(made.names, found.theta.tolist(), made.units, found.std.tolist())
    return tuple(Parameter(name, value, unit, std=std) for name, value, unit, std in values)


def take_reference(segment: Segment) -> Segment:
    """Return a segment with the reference in the place of the motion."""
    log = segment.log
    return segment._replace(log=replace(log, q=np.asarray(log.q_ref), v=None))
