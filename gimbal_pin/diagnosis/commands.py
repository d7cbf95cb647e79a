"""Causes that act on the command: what a saturated, dead or loose drive takes from the torque that was logged.

The motion cannot show a command beyond what acts, so these are no columns of the model's torque. The torque that acts,
``y = g(u)``, takes the place of the logged one u, and the model is fitted to it. Both models predict the acceleration:
with the error ``e = g(u) - Y(q, v, a) β`` and a joint's own inertia M(β), ``∂e/∂a = -M``, so that

    log p(a) = log p(e) + log M.

The gain of a joint's drive is ``D + n_j log(M_B/M_A)``, D the gain of the torque's error. A g that makes all torques
small makes M small as well, and gains nothing. Where the motion is too slow to show M (`shows_inertia`), rows that g
leaves alone have to fix the torque's scale: they must be half of all in time or in power (`fixes_scale`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np

from gimbal_pin.diagnosis.candidates import RESONANCE_BAND, Candidate
from gimbal_pin.diagnosis.problem import SHIFT, Problem, compute_torque
from gimbal_pin.diagnosis.score import BlockFit, compare_fits
from gimbal_pin.diagnosis.search import (
    Hit,
    Search,
    Solution,
    compute_solution_gain,
)
from gimbal_pin.effects import (
    ActuatorLag,
    Backlash,
    Cause,
    DeadZone,
    Delay,
    JointFlexibility,
    Saturation,
    Signal,
)
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.log.log import Array

LIMIT_SHARES = tuple(np.geomspace(0.06, 0.95, 14).tolist())
"""Limits that are tried, as shares of the largest torque; they are a fourth apart."""
SOFT_LIMITS = (0.7, 1.2, 2.0)
"""Soft limits that are tried, as shares of it."""
SOFT_KNEE = 2.0
"""Knee of these."""
WIDTHS = tuple(np.geomspace(0.03, 0.8, 12).tolist())
"""Widths of dead zones that are tried, as shares of the torque that 98 % stay under."""
SHARPNESSES = (0.0, 1.5, 4.0)
"""Sharpnesses of these; 0: a gap. Thresholds are tried besides."""
LATE_SECONDS = tuple(np.geomspace(2e-3, 0.06, 9).tolist())
"""Delays and lags that are tried, s."""
GAPS = (2.5e-4, 1e-3, 4e-3, 1.6e-2)
"""Gaps that are tried, rad."""
ROTOR_SHARES = (0.0, 0.25)
"""The rotor's share of the inertia: 0 for an encoder on the link."""
ROTOR_INERTIAS = (0.05, 0.3)
"""Inertia of the rotor in the gap, as a share of the joint's own."""
REPLACED_SHARE = 0.5
"""Share of the gain of a joint's causes that a drive in their place must have, before other causes join it."""
MOST_REFINED = 4
"""Most kinds of drives whose shapes are refined."""
CHANGED_SHARE = 0.1
"""Change of a torque, as a share of it, from which it is another one."""
SMALLEST_INERTIA = 1e-9
"""Inertia below which a joint has none, kg m²."""
COMMAND_LOG_PRIORS = {"saturation": -1.0, "dead-zone": -1.0, "joint-flexibility": -2.0}
"""Log priors of these causes, nats; 0 for the others."""


def list_command_causes(joint: str, seen: OperatingRange, inertia: float) -> list[Signal]:
    """Return the drives that are tried at a joint; `inertia`: its own, kg m²."""
    limits = [
        Saturation.inside(joint, share * seen.peak, side)
        for share in LIMIT_SHARES
        for side in (0, 1, -1)
    ]
    limits += [Saturation.inside(joint, share * seen.peak, 0, SOFT_KNEE) for share in SOFT_LIMITS]
    widths = [share * seen.torque for share in WIDTHS]
    zones = [DeadZone.inside(joint, width, sharp) for width in widths for sharp in SHARPNESSES]
    zones += [DeadZone.inside(joint, width, whole=True) for width in widths]
    gaps = [
        Backlash.inside(joint, gap, max(share * inertia, 1e-7), rotor)
        for gap in GAPS
        for share in ROTOR_INERTIAS
        for rotor in ROTOR_SHARES
    ]
    springs = [
        spring
        for spring in JointFlexibility.tried(joint, seen)
        if isinstance(spring, JointFlexibility) and _get_zero(spring) < RESONANCE_BAND * seen.band
    ]
    late: list[Signal] = [Delay.inside(joint, time) for time in LATE_SECONDS]
    late += [ActuatorLag.inside(joint, time) for time in LATE_SECONDS]
    return [*limits, *zones, *gaps, *late, *springs]


def _get_zero(spring: JointFlexibility) -> float:
    """Return the frequency at which a spring's torque is gone, Hz: the resonance with the rotor held."""
    return spring.frequency * sqrt(spring.rotor_share or 1.0)


@dataclass(frozen=True, eq=False)
class CommandHit:
    """A drive that was measured beside a model.

    Attributes:
        hit: Its gain in predicting the acceleration.
        torque: Torque that acts along each stretch, N m, (m,).
        fit: The model fitted to it.
    """

    hit: Hit
    torque: tuple[Array, ...]
    fit: BlockFit


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive that an explanation has.

    Attributes:
        hit: The drive, its gain less what it gains from noise.
        plain: The same with all of its gain, as the others have it.
        gain: Its gain with all causes refitted, by fold, nats, (K,).
        before: Error of the joint without it, N m.
        others: Drives of other kinds that gained clearly, too.
    """

    hit: CommandHit
    plain: Hit
    gain: Array
    before: float
    others: tuple[Hit, ...]


def compute_acting_torque(
    search: Search, solution: Solution, joint: int, signal: Signal
) -> tuple[Array, ...]:
    """Return the torque that acts behind a drive along each stretch, N m, (m,)."""
    if signal.geared and not signal.abrupt:
        commands = [part.samples.tau[:, joint] for part in search.problem.rows.stretches]
        return pass_commands(search, solution, joint, signal, commands)
    acting = list[Array]()
    for part in search.problem.rows.stretches:
        # A limit cuts each sample of the log, and not their smoothed course.
        logged = part.logged.tau[:, joint]
        lost = logged - signal.acting(logged, part.dt / part.logged.step)
        acting.append(part.samples.tau[:, joint] - part.logged.smoothed(lost))
    return tuple(acting)


def pass_commands(
    search: Search,
    solution: Solution,
    joint: int,
    signal: Signal,
    commands: Sequence[Array],
) -> tuple[Array, ...]:
    """Return what a drive makes of commands along each stretch, N m, (m,)."""
    problem = search.problem
    dry, viscous, _ = solution.fit.theta[problem.get_own_columns(joint)]
    inertia = get_inertia(problem, solution.fit, solution, joint)
    acting = list[Array]()
    for part, torque, command in zip(problem.rows.stretches, solution.torque, commands):
        if not signal.geared:
            acting.append(signal.acting(command, part.dt))
            continue
        x = part.samples
        brake = dry * part.direction[:, joint] + viscous * x.v[:, joint]
        inertial = inertia * x.a[:, joint]
        load = torque[:, joint] - brake - inertial
        still = part.weight[:, joint] == 0.0
        borne = JointLoad.along(brake, load, command, still, inertial)
        acting.append(signal.along(command, part.dt, borne))
    return tuple(acting)


def get_inertia(problem: Problem, fit: BlockFit, solution: Solution, joint: int) -> float:
    """Return a joint's own inertia in a fit, its rotor included, kg m²."""
    theta = fit.theta
    beta = problem.urdf + theta[: problem.base_count]
    total = float(problem.inertia[joint] @ beta) + float(problem.rig.armature[joint])
    for candidate in solution.accepted:
        if candidate.name == "armature" and candidate.joint == joint:
            total += float(theta[solution.get_places(candidate, problem)][0])
    return max(total, SMALLEST_INERTIA)


def measure_command(
    search: Search, solution: Solution, joint: int, signal: Signal, log_prior: float
) -> CommandHit:
    """Return what a drive gains beside a model."""
    problem = search.problem
    torque = compute_acting_torque(search, solution, joint, signal)
    fit = solution.fit.refit(_replace_target(search, solution, joint, torque))
    rows = solution.fit.rows
    by_fold = compare_fits(solution.fit, fit)
    before = get_inertia(problem, solution.fit, solution, joint)
    after = get_inertia(problem, fit, solution, joint)
    slope = log(after / before) + average_log_response(search, joint, signal, after)
    by_fold = by_fold + rows[:, joint] * slope
    if not (shows_inertia(problem, fit, joint, after) or fixes_scale(search, joint, torque)):
        by_fold = np.full(len(by_fold), -np.inf)
    candidate = Candidate(signal, joint, log_prior)
    hit = Hit(candidate, by_fold, np.zeros(0))
    return CommandHit(hit, torque, fit)


def _replace_target(
    search: Search, solution: Solution, joint: int, torque: Sequence[Array]
) -> Array:
    """Return a fit's whitened target with another torque at a joint, N m, (m,) per stretch."""
    problem = search.problem
    left = [x - known[:, joint] for x, known in zip(torque, problem.known)]
    target = solution.fit.target.copy()
    row = problem.rows.project(left, joint)
    target[:, joint] = search.whitening.apply(problem.rows, row, joint)[:, 0]
    return target


def shows_inertia(problem: Problem, fit: BlockFit, joint: int, inertia: float) -> bool:
    """Return whether the logs alone tell a joint's inertia to half of itself with 95 % confidence."""
    direction = problem.inertia[joint]
    scaled = np.zeros(len(fit.norms))
    scaled[: problem.base_count] = direction / fit.norms[: problem.base_count]
    known = float(scaled @ fit.inverse @ scaled)
    believed = float(direction**2 @ (1.0 / problem.precision))
    told = 1.0 / max(known, 1e-300) - 1.0 / believed
    return bool(told > 0 and 2.0 / np.sqrt(told) < 0.5 * inertia)


def fixes_scale(search: Search, joint: int, torque: Sequence[Array]) -> bool:
    """Return whether a drive leaves half of a joint's torque as it was, in time or in power."""
    command = search.problem.rows.join("tau")[:, joint]
    is_kept = np.abs(np.concatenate(torque) - command) < CHANGED_SHARE * np.abs(command)
    power = command**2
    return bool(max(is_kept.mean(), power[is_kept].sum() / max(power.sum(), 1e-300)) >= 0.5)


def screen_commands(search: Search, solution: Solution, joint: int) -> list[CommandHit]:
    """Return the best shape of each kind of drive at a joint, the best first."""
    problem = search.problem
    inertia = get_inertia(problem, solution.fit, solution, joint)
    signals = list_command_causes(problem.rig.joints[joint], problem.ranges[joint], inertia)
    best = dict[str, CommandHit]()
    for signal in signals:
        count = sum(other.name == signal.name for other in signals)
        prior = COMMAND_LOG_PRIORS.get(signal.name, 0.0) - log(count)
        hit = measure_command(search, solution, joint, signal, prior)
        if signal.name not in best or hit.hit.score > best[signal.name].hit.score:
            best[signal.name] = hit
    ranked = sorted(best.values(), key=lambda one: -one.hit.score)
    refined = [_refine_command(search, solution, joint, one) for one in ranked[:MOST_REFINED]]
    kin = [_try_kin(search, solution, joint, hit) for hit in refined]
    return sorted(kin, key=lambda one: -one.hit.score)


def _try_kin(search: Search, solution: Solution, joint: int, best: CommandHit) -> CommandHit:
    """Return the best of a drive and its other forms, which are too many for a grid."""
    candidate = best.hit.candidate
    prior = candidate.log_prior
    if not search.is_clear(best.hit, search.problem.settings.gain_nats):
        return best
    for cause in candidate.cause.akin(search.problem.ranges[joint]):
        assert isinstance(cause, Signal)
        tried = measure_command(search, solution, joint, cause, prior)
        if tried.hit.score > best.hit.score:
            best = tried
    return best


STEPS = {
    "saturation": (("limit", 1.1),),
    "dead-zone": (("width", 1.15),),
    "backlash": (("gap", 2.0),),
    "joint-flexibility": (("frequency", 1.15), ("damping", 2.0), ("rotor_share", 1.5)) * 2,
    "delay": (("time", 1.25),),
    "actuator-lag": (("time_constant", 1.25),),
}
"""Name of a drive → the shape parameters that are refined, and the factors of their first steps."""
HALVINGS = 4
"""Steps of a refinement, each the root of the one before."""


def _refine_command(search: Search, solution: Solution, joint: int, best: CommandHit) -> CommandHit:
    """Return a drive with the shape near its own that gains most."""
    for name, step in STEPS[best.hit.candidate.name]:
        for _ in range(HALVINGS):
            for factor in (1 / step, step):
                signal = _scale_shape(best.hit.candidate.cause, name, factor)
                prior = best.hit.candidate.log_prior
                tried = measure_command(search, solution, joint, signal, prior)
                if tried.hit.score > best.hit.score:
                    best = tried
            step = step**0.5
    return best


def _scale_shape(cause: Cause, name: str, factor: float) -> Signal:
    """Return a drive with a shape parameter times a factor; with another rotor's share the link swings as before."""
    if isinstance(cause, JointFlexibility) and name == "rotor_share":
        signal = cause.moved("frequency", cause.frequency / sqrt(factor))
    else:
        signal = cause.altered(**{name: factor * float(getattr(cause, name))})
    assert isinstance(signal, Signal)
    return signal


def discount_noise(search: Search, solution: Solution, joint: int, found: CommandHit) -> CommandHit:
    """Return a drive with its gain less what it gains on a torque that it leaves alone but for noise.

    A lag, a limit or a gap takes noise out of a torque as well, which is no sign of it. The imitated torque is that of
    the model with the drive, with its residual moved by half of each stretch. For a smooth drive it is also that of the
    model without: the residual there is noise, or it has the structure of which a true drive leaves nothing. A spring
    has to gain something even if all of the error is noise of the acceleration.
    """
    signal = found.hit.candidate.cause
    assert isinstance(signal, Signal)
    problem = search.problem
    with_drive = compute_torque(problem, found.fit.theta, solution.columns)
    measured = [part.samples.tau[:, joint] for part in problem.rows.stretches]
    models: list[tuple[Sequence[Array], Sequence[Array]]] = [(with_drive, found.torque)]
    is_smooth = signal.linear or (isinstance(signal, Saturation) and signal.knee > 0)
    if is_smooth:
        models.append((solution.torque, measured))
    by_fold = found.hit.by_fold
    for torque, acting in models:
        imitated = [
            x[:, joint] + np.roll(y - x[:, joint], len(y) // 2) for x, y in zip(torque, acting)
        ]
        gain = _measure_imitation(search, solution, joint, signal, imitated)
        by_fold = np.minimum(by_fold, found.hit.by_fold - max(float(gain.sum()), 0.0) / len(gain))
    inertia = get_inertia(problem, found.fit, solution, joint)
    known, most = (
        average_log_response(search, joint, signal, inertia, whole=whole) for whole in (False, True)
    )
    whole = by_fold.sum() + solution.fit.rows[:, joint].sum() * min(most - known, 0.0)
    if whole < problem.settings.gain_nats:
        by_fold = np.full(len(by_fold), -np.inf)
    return replace(found, hit=replace(found.hit, by_fold=by_fold))


def _measure_imitation(
    search: Search, solution: Solution, joint: int, signal: Signal, imitated: Sequence[Array]
) -> Array:
    """Return what a drive gains on an imitated torque, N m, (m,) per stretch, by fold."""
    problem = search.problem
    plain = solution.fit.refit(_replace_target(search, solution, joint, imitated))
    passed = pass_commands(search, solution, joint, signal, imitated)
    through = solution.fit.refit(_replace_target(search, solution, joint, passed))
    before, after = (get_inertia(problem, fit, solution, joint) for fit in (plain, through))
    slope = log(after / before) + average_log_response(search, joint, signal, after)
    return np.asarray(compare_fits(plain, through) + solution.fit.rows[:, joint] * slope)


def average_log_response(
    search: Search, joint: int, signal: Signal, inertia: float, *, whole: bool = False
) -> float:
    """Return what a spring takes out of the error by filtering the acceleration's noise, nats per row.

    H is what the error of a torque behind a spring feels of the joint's own acceleration, ``∂e/∂a = -M H``. Where the
    acceleration's noise makes up the share s of the error's power, the error falls by ``½ log(1 - s + s |H|²)``
    without any spring. Mean over the frequencies up to the band.

    Args:
        search: The search.
        joint: The joint.
        signal: The drive; 0 for others than springs.
        inertia: The joint's own inertia, kg m².
        whole: Whether all of the error may be noise of the acceleration; else only what the sensors' noise makes.
    """
    if not signal.springy:
        return 0.0
    part = search.problem.rows.stretches[0]
    count = len(part.time)
    impulse = np.zeros((count, 1))
    impulse[1] = 1.0  # a spring is at rest with the first sample
    felt = signal.felt(np.zeros((count, 1)), impulse, part.dt)[:, 0]
    frequency = np.fft.rfftfreq(count, part.dt)
    inside = (frequency > 0) & (frequency < search.problem.rows.band)
    power = np.maximum(np.abs(np.fft.rfft(felt))[inside] ** 2, 1e-12)
    if whole:
        return float(np.mean(0.5 * np.log(power)))
    whitening = search.whitening
    noise = inertia**2 * part.compute_acceleration_noise(joint, frequency[inside])
    gain = np.interp(frequency[inside], whitening.frequencies, whitening.gains[joint])
    share = np.minimum(noise * gain**2, 1.0)
    return float(np.mean(0.5 * np.log(1 - share + share * power)))


def find_commands(search: Search, final: Solution, joint: int) -> list[Drive]:
    """Return the drives that predict a joint's acceleration clearly better, beside its causes or in place of them.

    Args:
        search: The search.
        final: The model with all causes.
        joint: The joint.
    """
    nats = search.problem.settings.gain_nats
    models = [(final, 0.0)]
    own = [one for one in final.accepted if one.joint == joint]
    if own:
        without = search.fit_without(final, own)
        models.append((without, compute_solution_gain(without, final)))
    drives = list[Drive]()
    for solution, explained in models:
        hits = [
            one
            for one in screen_commands(search, solution, joint)
            if search.is_clear(one.hit, nats) and one.hit.gain > REPLACED_SHARE * explained
        ]
        for one in hits:
            sure = discount_noise(search, solution, joint, one)
            if search.is_clear(sure.hit, nats) and not _is_short(search, final, one.hit):
                others = tuple(x.hit for x in hits if x is not one)
                drives.append(Drive(sure, one.hit, sure.hit.by_fold, 0.0, others))
    return sorted(drives, key=lambda one: -one.hit.hit.score)


def _is_short(search: Search, solution: Solution, hit: Hit) -> bool:
    """Return whether a delay or a lag is within what the channels of one logger are apart."""
    cause = hit.candidate.cause
    joint = hit.candidate.joint
    if not isinstance(cause, Delay | ActuatorLag) or joint is None:
        return False
    problem = search.problem
    shifts = [solution.fit.theta[problem.get_own_columns(j).start + SHIFT] for j in problem.joints]
    late = float(shifts[joint]) + cause.late(problem.rows.stretches[0].dt)
    settings = problem.settings
    if late > settings.shift_seconds:
        return False
    return len(shifts) < 3 or late - float(np.median(shifts)) <= settings.shift_apart_seconds


def compute_drive_gain(search: Search, before: Solution, after: Solution, hit: Hit) -> Array:
    """Return the gain of a model with a drive in predicting the acceleration, by fold, nats, (K,)."""
    joint = hit.candidate.joint
    signal = hit.candidate.cause
    assert joint is not None and isinstance(signal, Signal)
    problem = search.problem
    rows = before.fit.rows
    gain = compare_fits(before.fit, after.fit)
    old = get_inertia(problem, before.fit, before, joint)
    new = get_inertia(problem, after.fit, after, joint)
    slope = log(new / old) + average_log_response(search, joint, signal, new)
    return np.asarray(gain + rows[:, joint] * slope)
