"""A torque that is the controller's answer to the motion: it tells the controller's gain, and nothing of the plant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import orth

from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.dynamics.regressor import (
    compute_gravity,
    compute_regressor,
    compute_rnea,
    name_columns,
)
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, Indices, classify_base_motion
from gimbal_pin.rig.rig import Rig

LEFT, WORSE = 0.01, 2.0
"""The formula leaves less than this share of the torque's power, and a passive plant so many times as much.

Of 126 bench logs (three rigs; excitation, staircases of speed, both ways and slow ones one way, sines; with and without
Stribeck friction and a spring, a bias and cogging) one joint is left less than the first by a formula of that sign, and
the plant leaves it 1.3 times as much, the most of all. Of two public logs of a speed loop the formula leaves 0.0003 and
0.003, and the plant 1700 and 3 times as much: the second's drive adds a map of the angle.
"""
INERT = 100.0
"""A function of the angles leaves so many times less power than the URDF's inertia asks for: a tenth of it would show.

Of twenty public logs and the bench logs above, with springs and cogging, what the inertia asks for is at most 6 times
what is left; of one whose controller cancels gravity, 1900 times.
"""
SEEN = 10.0
"""And the inertia's torque has so many times the power of the acceleration's noise, which would hide it."""
BAND = 0.1
"""Low-pass on all channels, as a share of the sampling rate: a loop acts below it, most of the noise is above."""
LATEST = 6
"""Samples by which the torque may answer late: measuring, computing and sending take one or two each."""
SHORTEST_FORMULA, FEWEST_FORMULA_SAMPLES, MOST_FORMULA_SAMPLES = 3.0, 100, 5000
"""A shorter log, s, or one of fewer samples, is not judged; of a longer one so many, spread evenly, are."""


class Formula(NamedTuple):
    """``τ(t) = a + c t + k q(t - d) - b v(t - d)`` of one joint, and a map of the angle where that turns round.

    b in N m s/rad, d in samples, and the mean square left.
    """

    gain: float
    delay: int
    left: float


def check_controller_formula(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``τ(t) = a + c t + k q(t - d) - b v(t - d) + m(q)``, b > 0: a linear controller, a reference of constant speed.

    Without a reference that moves otherwise, closed-loop data show the inverse of the controller (Ljung 1999, ch. 13),
    and least squares reads -b as viscous friction. No plant gives such a torque: friction takes power, so that its
    part along the rate has the other sign. The formula is found where it leaves next to nothing, and where the rigid
    bodies with a free constant, slope and spring, and with friction that takes power, leave several times as much.
    What passive plants give is in both, and leaves their ratio at one: so is a map m of the angle, where a joint turns
    round, which cogging asks for and drives feed forward. The samples are counted, as controllers do.
    A base that moves excites the plant whatever the reference does: such a log is not judged. Where this formula is not
    found, that of the angles alone is looked for (`check_formula_of_angles`).
    """
    if (
        log.tau is None
        or log.t[-1] - log.t[0] < SHORTEST_FORMULA
        or classify_base_motion(rig, log) != "fixed"
    ):
        return None
    sections = signals.lowpass(BAND, 1.0)
    edge = int(signals.compute_lowpass_settling(BAND)) + LATEST
    kept = np.arange(edge, len(log) - edge, max(1, len(log) // MOST_FORMULA_SAMPLES))
    if len(kept) < FEWEST_FORMULA_SAMPLES:
        return None
    q, tau = (signals.zero_phase(x, sections) for x in (log.q, log.tau))
    v = signals.differentiate(q, log.dt) if log.v is None else signals.zero_phase(log.v, sections)
    power = np.maximum(np.var(tau[kept], axis=0), 1e-300)
    maps = [build_angle_map(q[kept, j], v[kept, j], log.dt) for j in range(rig.n)]
    found = [fit_formula(log.t, q[:, j], v[:, j], tau[:, j], kept, maps[j]) for j in range(rig.n)]
    driven = np.ptp(log.tau, axis=0) > 0.0
    like = [
        j
        for j, formula in enumerate(found)
        if driven[j] and formula.gain > 0 and formula.left < LEFT * power[j]
    ]
    if not like:
        return check_formula_of_angles(rig, log, filtering)
    a = signals.differentiate(v, log.dt)
    A = compute_regressor(rig, q[kept], v[kept], a[kept], places=name_columns(rig)[1])
    rigid = {j: np.hstack([A[:, j, A[:, j].any(axis=0)], maps[j]]) for j in like}
    plant = {
        j: fit_passive_plant(log.t[kept], q[kept, j], v[kept, j], rigid[j], tau[kept, j])
        for j in like
    }
    worst = max(like, key=lambda j: plant[j] / max(found[j].left, 1e-300))
    if plant[worst] < WORSE * found[worst].left:
        return check_formula_of_angles(rig, log, filtering)
    joint = rig.joints[worst]
    (gain, delay, left) = found[worst]
    share = left / float(power[worst])
    by_plant = plant[worst] / float(power[worst])
    figures = (
        Parameter("gain", gain, "N m s/rad"),
        Parameter("delay", delay * log.dt, "s"),
        Parameter("left", share, "1"),
        Parameter("left_by_a_plant", by_plant, "1"),
    )
    late = f"(t - {digits(1e3 * delay * log.dt, 2)} ms)" if delay else ""
    sentence = (
        f"{joint}: the torque is the controller's formula of the motion, a - {digits(gain, 2)} N m s/rad · rate"
        f"{late}, which leaves {digits(100 * share, 1)} % of its power, where bodies with friction "
        f"leave {digits(100 * by_plant, 2)} %: what is identified as friction and inertia is the controller"
    )
    mend = "move the reference (gimbal-pin excite), at speeds that change, and record again"
    strength = plant[worst] / max(WORSE * left, 1e-300)
    return Examined(Fault("controller-formula", joint, sentence, figures, strength, False, mend))


def check_formula_of_angles(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``τ(t) = a + c t + k q(t - d) + G(q(t - d))``, G the bodies' weight: a controller that cancels gravity.

    A plant's torque moves its inertia, too. Somebody else's hand did, where these terms leave next to nothing of the
    torque beside what the URDF's inertia asks for at the measured accelerations: of this the part that they explain, as
    in a sine, is taken away.
    """
    assert log.tau is not None
    band = min(filtering.cutoff * log.dt, BAND)
    sections = signals.lowpass(band, 1.0)
    edge = int(signals.compute_lowpass_settling(band)) + LATEST
    kept = np.arange(
        edge, len(log) - edge, max(1, len(log) // MOST_FORMULA_SAMPLES, int(0.25 / band))
    )
    if len(kept) < FEWEST_FORMULA_SAMPLES:
        return None
    q, tau = (signals.zero_phase(x, sections) for x in (log.q, log.tau))
    v = signals.differentiate(q, log.dt)
    a = signals.differentiate(v, log.dt)[kept]
    noise = signals.noise_std(log.q) * signals.compute_noise_gain(sections, 1.0, 2) / log.dt**2
    asked = compute_rnea(rig, q[kept], v[kept], a) - compute_gravity(rig, q[kept])
    hidden = compute_rnea(rig.weightless, q[kept], 0.0 * a, np.tile(noise, (len(kept), 1)))
    still = np.zeros_like(a)
    left, inert = np.full((2, LATEST + 1, rig.n), np.inf)
    for delay in range(LATEST + 1):
        late = q[kept - delay]
        G = compute_regressor(rig, late, still, still, places=name_columns(rig)[1])
        for j in range(rig.n):
            own = G[:, j, G[:, j].any(axis=0)]
            free = span_columns(
                np.column_stack([np.ones(len(kept)), log.t[kept] - log.t[0], late[:, j], own])
            )
            rest = np.stack([tau[kept, j], asked[:, j]], axis=1)
            left[delay, j], inert[delay, j] = np.mean((rest - free @ (free.T @ rest)) ** 2, axis=0)
    best = np.argmin(left, axis=0)
    left = left[best, range(rig.n)]
    inert = inert[best, range(rig.n)]
    powers = np.maximum(np.var(tau[kept], axis=0), 1e-300)
    # A torque that is zero all along is no formula's; another check tells it.
    driven = np.ptp(log.tau, axis=0) > 0.0
    judged = driven & (inert > SEEN * np.mean(hidden**2, axis=0)) & (left < LEFT * powers)
    ratio = np.where(judged, inert / np.maximum(left, 1e-300), 0.0)
    worst = int(np.argmax(ratio))
    if ratio[worst] < INERT:
        return None
    power = float(powers[worst])
    figures = (
        Parameter("delay", float(best[worst]) * log.dt, "s"),
        Parameter("left", float(left[worst]) / power, "1"),
        Parameter("left_by_a_plant", float(inert[worst]) / power, "1"),
    )
    sentence = (
        f"{rig.joints[worst]}: the torque is the controller's formula of the angle, which leaves "
        f"{digits(100 * float(left[worst]) / power, 1)} % of its power, where the URDF's inertia alone asks for "
        f"{digits(100 * float(inert[worst]) / power, 2)} %: something else moved the joint, and the log shows neither "
        f"friction nor inertia"
    )
    mend = "let the motor move the joint (gimbal-pin excite), with no hand on it, and record again"
    return Examined(
        Fault(
            "controller-formula",
            rig.joints[worst],
            sentence,
            figures,
            float(ratio[worst]) / INERT,
            True,
            mend,
        )
    )


def build_angle_map(q: Array, v: Array, dt: float) -> Array:
    """``cos kq, sin kq``, (m, 2K), of a joint that turns round: of every k that passes within `BAND`, or none."""
    passing = int(2 * np.pi * BAND / (dt * max(float(np.max(np.abs(v))), 1e-300)))
    count = min(passing, len(q) // 8) if np.ptp(q) > 2 * np.pi else 0
    phase = np.outer(q, np.arange(1, count + 1))
    return np.hstack([np.cos(phase), np.sin(phase)])


def fit_formula(t: Array, q: Array, v: Array, tau: Array, kept: Indices, beside: Array) -> Formula:
    """Return the formula of one joint that fits the samples `kept` best, with columns `beside`; `left` in N² m²."""
    fits = []
    for delay in range(LATEST + 1):
        A = np.column_stack(
            [np.ones(len(kept)), t[kept] - t[0], q[kept - delay], v[kept - delay], beside]
        )
        x = np.linalg.lstsq(A, tau[kept], rcond=None)[0]
        fits.append(Formula(-float(x[3]), delay, float(np.mean((tau[kept] - A @ x) ** 2))))
    return min(fits, key=lambda fit: fit.left)


def fit_passive_plant(t: Array, q: Array, v: Array, rigid: Array, tau: Array) -> float:
    """Mean square that bodies, a constant, a slope, a spring, and dry and viscous friction over zero leave, N² m².

    `rigid`: columns of the bodies, and of what else is free, (m, k).
    """
    from scipy.optimize import nnls

    free = np.column_stack([np.ones(len(t)), t - t[0], q, rigid])
    left = span_columns(free)
    friction, rest = (x - left @ (left.T @ x) for x in (np.column_stack([np.sign(v), v]), tau))
    return float(nnls(friction, rest)[1] ** 2 / len(t))


def span_columns(A: Array) -> Array:
    """Return orthonormal columns that span those of A, (m, r)."""
    return np.asarray(orth(A / np.maximum(np.linalg.norm(A, axis=0), 1e-300), rcond=1e-9))
