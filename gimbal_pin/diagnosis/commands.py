"""Causes that act on the command: what a saturated, dead or loose drive takes from the torque that was logged.

The motion cannot show a command beyond what acts, so these are no columns of the model's torque. The torque that acts,
``y = g(u)``, takes the place of the logged one u, and the model is fitted to it. Both models predict the acceleration:
with the error ``e = g(u) - Y(q, v, a) β`` and a joint's own inertia M(β), ``∂e/∂a = -M``, so that

    log p(a) = log p(e) + log M.

The gain of a joint's drive is ``D + n_j log(M_B/M_A)``, D the gain of the torque's error. A g that makes all torques
small makes M small as well, and gains nothing. Where the motion is too slow to show M (`_shows_inertia`), rows that g
leaves alone have to fix the torque's scale: they must be half of all in time or in power (`_fixes_scale`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import log

import numpy as np

from gimbal_pin.diagnosis.candidates import LOG_PRIORS, RESONANCE_BAND, Candidate
from gimbal_pin.diagnosis.problem import SHIFT, Problem, compute_torque
from gimbal_pin.diagnosis.score import BlockFit, compare_fits
from gimbal_pin.diagnosis.search import Hit, Search, Solution, compute_solution_gain
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

STEPS = {
    "saturation": {"limit": 1.1},
    "dead-zone": {"width": 1.15},
    "backlash": {"gap": 2.0, "rotor_share": 1.5},
    "joint-flexibility": {"frequency": 1.15, "damping": 2.0, "rotor_share": 1.5},
    "delay": {"time": 1.4},
    "actuator-lag": {"time_constant": 1.4},
}
"""Name of a drive → the shape parameters that are refined, and the factors of their first steps."""
KINDS = (Saturation, DeadZone, Backlash, JointFlexibility, Delay, ActuatorLag)
"""Drives that are tried."""
ROUNDS = 8
"""Rounds of a refinement; where one does not gain, the next takes the root of its steps. It bounds the
time."""
HIGHEST_LIMIT = 2.0
"""Highest limit that is tried, as a share of the largest torque: a soft one beyond bends it by less than an eighth."""
MOVES: tuple[float, ...] = (1 / 2, 1 / 3, 2 / 3)
"""Shares of a stretch by which residuals are moved to imitate noise: half for a filter, thirds to meet chance twice."""
SLOPE_STEP = 1.01
"""Factor of a shape parameter by which the slope of the acting torque is computed."""
SMALLEST_INERTIA = 1e-9
"""Inertia below which a joint has none, kg m²: its logarithm must exist."""


def list_drives(kind: type[Cause], joint: str, seen: OperatingRange) -> list[Cause]:
    """Return the drives of one kind that are tried at a joint.

    Of springs those that swing well inside the band, of limits those that bend the torque visibly.
    """
    drives = list[Cause]()
    for x in kind.tried(joint, seen):
        if isinstance(x, JointFlexibility):
            hertz = x.held.frequency if x.geared else x.frequency
            if hertz >= RESONANCE_BAND * seen.band:
                continue
        if isinstance(x, Saturation) and x.limit > HIGHEST_LIMIT * seen.peak:
            continue
        drives.append(x)
    return drives


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive that was measured beside a model.

    Attributes:
        hit: Its gain in predicting the acceleration.
        torque: Torque that acts along each stretch, N m, (m,).
        fit: The model fitted to it.
        gain: Its gain less what it gains from noise, or with all causes refitted, by fold, nats, (K,).
        before: Error of the joint without it, N m.
        others: Drives of other kinds that gained clearly, too.
    """

    hit: Hit
    torque: Sequence[Array]
    fit: BlockFit
    gain: Array
    before: float = 0.0
    others: tuple[Hit, ...] = ()

    @property
    def signal(self) -> Signal:
        """The map from the command to the torque that acts."""
        assert isinstance(self.hit.candidate.cause, Signal)
        return self.hit.candidate.cause


def _get_score(drive: Drive) -> float:
    """Return gain and log prior, nats."""
    return drive.hit.score


@dataclass(frozen=True, eq=False)
class DriveTest:
    """A joint's logged torque and a model, to which drives are added.

    Attributes:
        search: The search.
        solution: The model.
        joint: The joint.
        known: Drives that do not read the model → torque that acts behind them along each stretch, N m, (m,).
    """

    search: Search
    solution: Solution
    joint: int
    known: dict[Signal, Sequence[Array]] = field(default_factory=dict)

    @property
    def commands(self) -> list[Array]:
        """The logged torque along each stretch, N m, (m,)."""
        return [x.samples.tau[:, self.joint] for x in self.search.problem.rows.stretches]

    def measure(self, causes: Sequence[Cause], log_prior: float) -> list[Drive]:
        """Return what drives gain beside the model."""
        signals = [x for x in causes if isinstance(x, Signal)]
        torques = self.compute_acting_torques(signals)
        if not torques:
            return []
        drives = list[Drive]()
        for signal, torque, fit in zip(signals, torques, self.fit_torques(torques)):
            gain = self.measure_gain(self.solution.fit, fit)
            if gain.sum() > 0 and not (self._shows_inertia(fit) or self._fixes_scale(torque)):
                gain = np.full(len(gain), -np.inf)
            hit = Hit(Candidate(signal, self.joint, log_prior), gain, np.zeros(0))
            drives.append(Drive(hit, torque, fit, gain))
        return drives

    def measure_gain(self, before: BlockFit, after: BlockFit) -> Array:
        """Return the gain of a fit to another torque in predicting the acceleration, by fold, nats, (K,)."""
        old, new = (
            compute_inertia(self.search.problem, self.solution, self.joint, fit)
            for fit in (before, after)
        )
        return compare_fits(before, after) + before.rows[:, self.joint] * log(new / old)

    def fit_torques(self, torques: Sequence[Sequence[Array]]) -> Iterator[BlockFit]:
        """Yield the model fitted to each of some torques at the joint, N m, (m,) per stretch."""
        problem = self.search.problem
        left = [
            np.stack(x, axis=1) - known[:, [self.joint]]
            for x, known in zip(zip(*torques), problem.known)
        ]
        rows = problem.rows.project(left, self.joint)
        for row in self.search.whitening.apply(problem.rows, rows, self.joint).T:
            target = self.solution.fit.target.copy()
            target[:, self.joint] = row
            yield self.solution.fit.refit(target)

    def pass_commands(self, signal: Signal, commands: Sequence[Array]) -> list[Array]:
        """Return what a drive makes of commands along each stretch, N m, (m,)."""
        problem = self.search.problem
        j = self.joint
        dry, viscous, _ = self.solution.fit.theta[problem.get_own_columns(j)]
        inertia = compute_inertia(problem, self.solution, j)
        acting = list[Array]()
        for part, torque, command in zip(problem.rows.stretches, self.solution.torque, commands):
            x = part.samples
            brake = dry * part.direction[:, j] + viscous * x.v[:, j]
            inertial = inertia * x.a[:, j]
            still = part.weight[:, j] == 0.0
            load = torque[:, j] - brake - inertial
            borne = JointLoad.along(brake, load, command, still, inertial)
            acting.append(signal.along(command, part.dt, borne))
        return acting

    def compute_acting_torques(self, signals: Sequence[Signal]) -> list[Sequence[Array]]:
        """Return the torque that acts behind each drive along each stretch, N m, (m,)."""
        read_log = [x for x in signals if x.abrupt or not x.geared]
        new = [x for x in read_log if x not in self.known]
        if new:
            parts = [x.T for x in self._pass_logged(new)]
            self.known.update(zip(new, zip(*parts)))
        commands = self.commands
        return [
            self.known[x] if x in self.known else self.pass_commands(x, commands) for x in signals
        ]

    def _pass_logged(self, signals: Sequence[Signal]) -> Iterator[Array]:
        """Yield what drives make of each sample of the log, smoothed like the torque, N m, (m, k) per stretch."""
        for part in self.search.problem.rows.stretches:
            logged = part.logged.tau[:, self.joint]
            dt = part.dt / part.logged.step
            lost = np.stack([logged - x.acting(logged, dt) for x in signals], axis=1)
            yield part.samples.tau[:, [self.joint]] - part.logged.smoothed(lost)

    def _shows_inertia(self, fit: BlockFit) -> bool:
        """Return whether the joint's inertia is known to half of itself, by two deviations."""
        problem = self.search.problem
        direction = problem.inertia[self.joint]
        covariance = fit.white_covariance[: problem.base_count, : problem.base_count]
        inertia = compute_inertia(problem, self.solution, self.joint, fit)
        std = np.sqrt(direction @ covariance @ direction)
        settings = problem.settings
        return bool(settings.clear_deviations * std < settings.main_share * inertia)

    def _fixes_scale(self, torque: Sequence[Array]) -> bool:
        """Return whether a drive leaves half of the joint's torque as it was, in time or in power."""
        settings = self.search.problem.settings
        command = np.concatenate(self.commands)
        change = np.abs(np.concatenate(torque) - command)
        is_kept = change < settings.max_change_share * np.abs(command)
        power = command**2
        share = max(is_kept.mean(), power[is_kept].sum() / max(power.sum(), 1e-300))
        return bool(share >= settings.main_share)

    def screen(self) -> list[Drive]:
        """Return the best shape of each kind of drive, the best first."""
        problem = self.search.problem
        best = list[Drive]()
        for kind in KINDS:
            name = problem.rig.joints[self.joint]
            signals = list_drives(kind, name, problem.ranges[self.joint])
            prior = LOG_PRIORS.get(kind.name, 0.0) - log(max(len(signals), 1))
            best += sorted(self.measure(signals, prior), key=_get_score)[-1:]
        if any(x.hit.score > 0 for x in best):
            best = [self._refine(x) for x in best]
        return sorted(best, key=_get_score, reverse=True)

    def _refine(self, best: Drive) -> Drive:
        """Return a drive with the shape near its own that gains most, or of a form that is too dear for a grid."""
        prior = best.hit.candidate.log_prior
        power = 1.0
        for _ in range(ROUNDS):
            last = best
            for name, step in STEPS[best.signal.name].items():
                value = float(getattr(best.signal, name))
                values = (value / step**power, value * step**power)
                moved = [best.signal.moved(name, x) for x in values]
                best = max([best, *self.measure(moved, prior)], key=_get_score)
            if best is last:
                power /= 2
        if not self.search.is_clear(best.hit, self.search.problem.settings.gain_nats):
            return best
        forms = best.signal.akin(self.search.problem.ranges[self.joint])
        prior -= log(max(len(forms), 1))
        return max([best, *self.measure(forms, prior)], key=_get_score)

    def discount_noise(self, found: Drive) -> Hit:
        """Return a drive's gain less what it gains on torques that it leaves alone but for noise.

        A lag takes noise out of a torque as well, and of the shapes of a limit or a gap, which do so by chance, the
        best was chosen: so it is from noise. The imitated torques are that of the model with the drive, with its
        residual moved along each stretch. For a smooth drive they are also that of the model without: the residual
        there is noise, or has the structure of which a true drive leaves nothing. A spring has to gain something even
        if all of the error is noise of the acceleration.
        """
        problem = self.search.problem
        fit = self.solution.fit
        with_drive = compute_torque(problem, found.fit.theta, self.solution.columns)
        gain = found.hit.by_fold
        models = [(with_drive, found.torque)]
        if found.signal.linear or getattr(found.signal, "knee", 0.0) > 0.0:
            models.append((list(self.solution.torque), self.commands))
        signals = [found.signal]
        moves = MOVES[:1]
        if not found.signal.linear:
            shapes = list_drives(type(found.signal), found.signal.place, problem.ranges[self.joint])
            signals += [x for x in shapes if isinstance(x, Signal)]
            moves = MOVES[1:]
        for (torque, acting), share in product(models, moves):
            own = [x[:, self.joint] for x in torque]
            imitated = [x + np.roll(y - x, int(share * len(y))) for x, y in zip(own, acting)]
            passed = [self.pass_commands(signal, imitated) for signal in signals]
            plain, *fits = self.fit_torques([imitated, *passed])
            noise = max(float(self.measure_gain(plain, x).sum()) for x in fits)
            gain = np.minimum(gain, found.hit.by_fold - max(noise, 0.0) / len(gain))
        filtered = float(fit.rows[:, self.joint].sum()) * _average_log_response(
            problem, found.signal
        )
        if gain.sum() + min(filtered, 0.0) < problem.settings.gain_nats:
            gain = np.full(len(gain), -np.inf)
        return replace(found.hit, by_fold=gain)


def compute_inertia(
    problem: Problem, solution: Solution, joint: int, fit: BlockFit | None = None
) -> float:
    """Return a joint's own inertia in a model, its rotor included, kg m²; `fit`: another fit of the model."""
    theta = (fit or solution.fit).theta
    total = float(problem.inertia[joint] @ (problem.urdf + theta[: problem.base_count]))
    total += float(problem.rig.armature[joint])
    for candidate in solution.accepted:
        if candidate.name == "armature" and candidate.joint == joint:
            total += float(theta[solution.get_places(candidate, problem)][0])
    return max(total, SMALLEST_INERTIA)


def _average_log_response(problem: Problem, signal: Signal) -> float:
    """Return what a spring takes out of the error by filtering the acceleration's noise, nats per row.

    ``H = r + (1 - r) N`` is what the error of a torque behind a spring feels of the joint's own acceleration,
    ``∂e/∂a = -M H``, N the resonance of the link with the rotor held and r the rotor's share. If all of the error comes
    from noise of the acceleration, it falls by ``log |H|`` without any spring. Mean up to the band.
    """
    if not (isinstance(signal, JointFlexibility) and signal.springy):
        return 0.0
    r = signal.rotor_share
    ratio = np.linspace(0.0, problem.rows.band, 1000) / signal.held.frequency
    resonance = 1.0 / (1.0 - ratio**2 + 2j * signal.held.damping * ratio)
    return float(np.mean(np.log(np.abs(r + (1.0 - r) * resonance))))


def find_drives(search: Search, final: Solution, joint: int) -> list[Drive]:
    """Return the drives that predict a joint's acceleration clearly better, beside its causes or in place of them.

    Args:
        search: The search.
        final: The model with all causes.
        joint: The joint.
    """
    settings = search.problem.settings
    nats = settings.gain_nats
    test = DriveTest(search, final, joint)
    tests = [(test, 0.0)]
    causes = [x for x in final.accepted if x.joint == joint]
    if causes:
        without = search.fit_without(final, causes)
        tests.append((replace(test, solution=without), compute_solution_gain(without, final)))
    drives = list[Drive]()
    for test, explained in tests:
        clear = [
            x
            for x in test.screen()
            if search.is_clear(x.hit, nats) and x.hit.gain > settings.main_share * explained
        ]
        for drive in clear:
            sure = test.discount_noise(drive)
            is_other = _is_short(search, final, drive, joint) or _is_damped_out(drive)
            if search.is_clear(sure, nats) and not is_other:
                others = tuple(x.hit for x in clear if x is not drive)
                drives.append(replace(drive, gain=sure.by_fold, others=others))
    return sorted(drives, key=lambda x: -(float(x.gain.sum()) + x.hit.candidate.log_prior))


def _is_short(search: Search, solution: Solution, drive: Drive, joint: int) -> bool:
    """Return whether a delay or a lag is within what the channels of one logger are apart."""
    problem = search.problem
    shift = float(solution.fit.theta[problem.get_own_columns(joint).start + SHIFT])
    late = shift + drive.signal.late(problem.rows.stretches[0].dt)
    return isinstance(drive.signal, Delay | ActuatorLag) and late <= problem.settings.shift_seconds


def _is_damped_out(drive: Drive) -> bool:
    """Return whether a spring's damping has run to its bound: nothing swings there, and it is a filter of noise."""
    bounds = {x.name: x.upper for x in drive.signal.shapes}
    return getattr(drive.signal, "damping", 0.0) >= bounds.get("damping", np.inf)


def compute_drive_gain(search: Search, before: Solution, after: Solution, drive: Drive) -> Array:
    """Return the gain of a model with a drive in predicting the acceleration, by fold, nats, (K,)."""
    joint = drive.hit.candidate.joint
    assert joint is not None
    old, new = (compute_inertia(search.problem, x, joint) for x in (before, after))
    return compare_fits(before.fit, after.fit) + before.fit.rows[:, joint] * log(new / old)


def compute_slopes(search: Search, solution: Solution, drive: Drive) -> dict[str, Array]:
    """Return how the acting torque changes with the logarithm of each shape of a drive that is not zero, N m, (N,)."""
    joint = drive.hit.candidate.joint
    assert joint is not None
    signal = drive.signal
    test = DriveTest(search, solution, joint)
    slopes = dict[str, Array]()
    for name in (x.name for x in signal.shapes if getattr(signal, x.name) > 0):
        value = getattr(signal, name)
        pair = [signal.altered(**{name: value * x}) for x in (1 / SLOPE_STEP, SLOPE_STEP)]
        low, high = test.compute_acting_torques(pair)
        span = log(getattr(pair[1], name) / getattr(pair[0], name))
        rows = [(y - x)[:, None] / span for x, y in zip(low, high)]
        slopes[name] = search.problem.rows.project(rows, joint)[:, 0]
    return slopes
