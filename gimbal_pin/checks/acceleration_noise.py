"""Noise in the regressor: accelerations drowned in the sensors' noise, and parameters in spite of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gimbal_pin.checks.clock import separate_jitter
from gimbal_pin.checks.harm import MATERIAL, build_design
from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.checks.series import estimate_angle_noise, estimate_local_noise, find_step
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    HIGHEST_CUTOFF,
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
"""Noise of the smoothed acceleration, as a multiple of the motion's rms below the cutoff, from which it is reported.

Twice as much would leave out encoders that bias an inertia by a quarter at four times the cutoff.
"""
JUDGED_PARTS = 24
"""Parts of the log, the worst of which is judged."""
CUTOFF_RAISE_FACTOR = 4.0
"""Factor by which the cutoff is raised to see whether the parameters depend on it."""
MAX_CUTOFF_DEPENDENCE = 0.1
"""Change of the torque at the raised cutoff, as a share of its rms, from which the dependence is a finding.

It does not make the physics unreliable: nothing is fitted at the raised cutoff. Twice as much leaves it a note.
"""
FOLLOWS = 0.2
"""A joint follows its reference if the difference is under this share of the reference's spread."""


def check_acceleration_noise(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``A = A(true motion) + noise``: least squares then shrinks towards zero what multiplies the acceleration.

    The sensors' noise says whether the acceleration drowns. Whether that harms the fit, a test says: do even and odd
    samples as each other's instruments (`fit_repeated`) give other parameters than least squares at the given cutoff
    (Durbin, Wu and Hausman)? Both halves saw the same motion, so a wrong model changes both alike, and only noise makes
    the difference. It is asked of the torque at the joints whose acceleration drowns, and beyond what the torque's own
    noise does. How far the parameters depend on the cutoff is reported beside it, and decides nothing.
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
    middle = fit_weighted([a._replace(A=(a.A + b.A) / 2) for a, b in zip(*halves)])
    raised = min(CUTOFF_RAISE_FACTOR, HIGHEST_CUTOFF / (log.dt * filtering.cutoff))
    wider = fit_weighted(list(raise_cutoff(made, raised)))
    pairs = ((crossed, middle), (fit_weighted(rows), wider))
    bias, walk = (float(compute_change(rows, *pair)[drowned >= DROWNED].max()) for pair in pairs)
    share = float(drowned.max())
    worst = int(np.argmax(drowned))
    cutoff = filtering.cutoff
    figures = (
        Parameter("noise_share", share, "1"),
        Parameter("bias", bias, "1"),
        Parameter("walk", walk, "1"),
        Parameter("cutoff", cutoff, "Hz"),
    )
    answer = estimate_answer(log, made, rows, crossed)
    step = find_step(log.q[:, worst])
    cause = "acceleration-noise"
    bits = np.log2(2 * np.pi / step) if step else 0.0
    coarse = (
        f" (encoder steps of {digits(1000 * step, 2)} mrad, {bits:.0f} bits per turn)"
        if step
        else ""
    )
    unreliable = bias > MATERIAL
    end = f"at {cutoff:g} Hz it does no harm"
    if walk > MAX_CUTOFF_DEPENDENCE:
        end += f"; a cutoff of {digits(raised * cutoff, 2)} Hz would change the torque by {digits(100 * walk, 2)} %"
    if unreliable:
        end = (
            f"it changes the parameters by {digits(100 * bias, 2)} % of the torque at {cutoff:g} Hz"
        )
    joint = rig.joints[worst]
    sentence = (
        f"{joint}: noise is {digits(share, 2)} times the motion's own acceleration{coarse}; {end}"
    )
    mend = (
        "record with a finer encoder or a gyro, faster motion, and at least 30 s; use the estimate by instrumental "
        "variables until then"
    )
    strength = share / DROWNED
    slight = not unreliable and walk <= MAX_CUTOFF_DEPENDENCE
    return Examined(
        Fault(cause, joint, sentence, figures, strength, unreliable, mend, answer, slight=slight)
    )


def take_half(segment: Segment, first: int) -> Segment:
    """Return a segment's grid over every second sample of its log: the halves' white noise is independent."""
    log = segment.log.part(slice(segment.rows.start + first, segment.rows.stop, 2))
    return segment._replace(log=log, rows=slice(0, len(log)))


def raise_cutoff(design: Design, factor: float) -> Design:
    """Return a design of the same smooth channels with the rows' cutoff so many times as high."""
    now = design.filtering
    direction = None if now.direction is None else now.direction / factor
    wider = replace(
        now, cutoff=factor * now.cutoff, smoothing=now.smoothing / factor, direction=direction
    )
    return replace(design, filtering=wider)


def compute_noise_share(log: Log, filtering: Filtering) -> Array | None:
    """Noise of the smoothed acceleration in the worst part, over the motion's acceleration, (n,); None without any.

    From the angle's noise or, where there is one, the rate's, by whichever says less. The angle's noise is taken over
    the stamps and over an even clock, whichever gives less: stamps that jitter are no noise of the encoder.
    """
    long = [
        part
        for part in split_segments(log, filtering.cutoff)
        if part.dt * part.length > 1.0 / filtering.cutoff
    ]
    if not long or len(log) < 8 * JUDGED_PARTS:
        return None
    rate = 1.0 / log.dt
    smoothing = filtering.cutoff * filtering.smoothing
    slow = signals.lowpass(filtering.cutoff, rate)
    a = [
        signals.zero_phase(smooth_samples(part, filtering, 0, part.length).a, slow) for part in long
    ]
    size = np.maximum(np.std(np.concatenate(a), axis=0), 1e-300)
    sections = signals.lowpass(smoothing, rate)
    once, twice = (
        signals.compute_noise_gain(sections, rate, derivatives) for derivatives in (1, 2)
    )
    clocks = (log.t, separate_jitter(log.t).steady)
    local = np.min([estimate_local_noise(t, log.q, JUDGED_PARTS) for t in clocks], axis=0)
    noise = twice * estimate_angle_noise(log, local)
    if log.v is not None:
        noise = np.minimum(noise, once * estimate_local_noise(log.t, log.v, JUDGED_PARTS))
    return np.asarray(np.where(np.ptp(log.q, axis=0) > 0, noise.max(axis=0) / size, 0.0))


def compute_change(rows: Sequence[Block], first: Estimate, second: Estimate) -> Array:
    """Return what the second parameters change in each joint's torque in these rows, as a share of its rms, (n,).

    ``√(max(‖A Δθ‖² - tr A C Aᵀ, 0)/‖b‖²)``, C the first's covariance: the torque's noise moves them by as much.
    """
    A = np.concatenate([block.A for block in rows])
    b = np.concatenate([block.b for block in rows])
    known = np.where(np.isfinite(first.covariance), first.covariance, 0.0)
    expected = np.mean(np.sum((A @ known) * A, axis=2), axis=0)
    moved = np.mean((A @ (second.theta - first.theta)) ** 2, axis=0)
    power = np.mean(b**2, axis=0)
    felt = np.where(power > 1e-6 * power.max(), power, np.inf)
    return np.asarray(np.sqrt(np.maximum(moved - expected, 0.0) / felt))


def estimate_answer(
    log: Log, made: Design, rows: Sequence[Block], crossed: Estimate
) -> tuple[Parameter, ...]:
    """Return base parameters and friction by instrumental variables, at the given cutoff.

    The reference's own columns are the instruments where the log holds a reference and the joints follow it: it knows
    nothing of the sensors' noise, coloured or not. Else each half of the samples is the other's: `crossed`.
    """
    found = crossed
    if log.q_ref is not None and np.all(
        np.std(log.q - log.q_ref, axis=0) <= FOLLOWS * np.std(log.q_ref, axis=0)
    ):
        found = fit_instrumental(rows, [block.A for block in made.iterate_blocks(take_reference)])
    values = zip(made.names, found.theta.tolist(), made.units, found.std.tolist())
    return tuple(Parameter(name, value, unit, std=std) for name, value, unit, std in values)


def take_reference(segment: Segment) -> Segment:
    """Return a segment with the reference in the place of the motion."""
    log = segment.log
    return segment._replace(log=replace(log, q=np.asarray(log.q_ref), v=None))
