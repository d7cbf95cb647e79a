"""Causes chosen so far, refitted with the rigid model and friction: one step of the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.columns import (
    Bearing,
    Columns,
    Load,
    RigidColumns,
    Stand,
    build_columns,
    compute_plain_columns,
    get_magnitude,
)
from gimbal_pin.diagnosis.evidence import Evidence, LogStretch
from gimbal_pin.diagnosis.fit import LUCK, Fit, fit
from gimbal_pin.dynamics.model import build_friction_effects, is_motor_friction
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.identification import given_beta
from gimbal_pin.log.log import Array
from gimbal_pin.regression import MotionNoise, compare_instruments, find_base_columns
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

UNFADED_SHARE, AVERAGED_FREQUENCIES = 0.75, 8
"""Share of the band that does not fade, and frequencies that are averaged where two spectra are compared."""
SETTLED_CHANGE = 1e-4
"""Change of a torque, as a share, under which one that reads itself has settled."""
SETTLING_PASSES = 5
"""Most rounds of that."""
FITTED = 0.01
"""The same for the dispersions."""
BENT = 0.02
"""Angle from which a turned rig's torque is built at that angle, rad."""
CACHED_EFFECTS = 200
"""Effects whose columns are kept."""
AIMED = 0.001
"""Change of that angle, as a share, under which it has settled."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Logs with the rigid model's columns, computed once.

    Attributes:
        evidence: The logs.
        reduction: Base parameters that their motion shows.
        rigid: Their columns, whitened, (rows, n, b).
        motion: The same in N m, whatever whitens them.
        luck: Least dispersion that is believed.
    """

    evidence: Evidence
    reduction: Reduction
    rigid: Array
    motion: RigidColumns
    luck: float = LUCK
    kept: dict[Effect, tuple[Array, list[Array]]] = field(
        default_factory=dict, init=False, repr=False
    )

    __repr__ = brief

    @staticmethod
    def of(evidence: Evidence, reduction: Reduction) -> Problem:
        """Compute the columns."""
        motion = RigidColumns.of(evidence, reduction)
        return Problem(evidence, reduction, evidence.whiten_all(motion.full), motion)

    @cached_property
    def motion_noise(self) -> MotionNoise:
        """Inertia about each joint's axis, kg m², by least squares and by slow motion as instruments.

        Where the two say something else, much of the faster motion is not the torque's: it is noise of the angles, or
        what shakes the joint and the controller answers to, and attenuates inertia.
        """
        now = solve_causes(self, ())
        slow = solve_causes(
            Problem.of(self.evidence.low_pass_motion(MotionNoise.cutoff), self.reduction),
            (),
            now,
            keep=True,
        )
        figures = np.zeros((self.evidence.rig.n, now.fit.stack.shape[1]))
        figures[:, : self.motion.inertia.shape[1]] = self.motion.inertia
        return compare_instruments(
            now.fit.stack, slow.fit.stack, now.fit.target, now.fit.block, figures
        )

    @cached_property
    def friction(self) -> tuple[Effect, ...]:
        """Coulomb and viscous friction of every joint."""
        return build_friction_effects(self.evidence.rig.joints)

    def build(self, cause: Cause, stand: Stand, load: Load, acting: list[Array]) -> Array:
        """Return a cause's whitened columns at all joints, (rows, n, c); see `columns.build_columns`."""
        if reads_fit(cause) or not isinstance(cause, Effect):
            return build_columns(self.evidence, cause, stand, load, acting).values
        return self.built(cause, load)[0]

    def plain(self, effect: Effect, load: Load) -> list[Array]:
        """Return a torque effect's columns at its joint as they are, (m, c) per part."""
        return (
            compute_plain_columns(self.evidence, effect, load)
            if reads_fit(effect)
            else self.built(effect, load)[1]
        )

    def built(self, effect: Effect, load: Load) -> tuple[Array, list[Array]]:
        """Return both for an effect that reads nothing but the log: built once, the last ones kept."""
        if effect not in self.kept:
            while len(self.kept) >= CACHED_EFFECTS:
                del self.kept[next(iter(self.kept))]
            values = build_columns(
                self.evidence, effect, load.stand, load, self.evidence.torque
            ).values
            self.kept[effect] = values, compute_plain_columns(self.evidence, effect, load)
        return self.kept[effect]


@dataclass(frozen=True, eq=False)
class State:
    """Causes chosen so far, all refitted with the rigid model.

    Attributes:
        problem: The logs.
        causes: The chosen causes.
        fit: The fit.
        rig: The rig with the fitted inertias.
        torque: What the model predicts of `acting`, N m, (m, n) per part: columns that read a torque are built from it,
            as the measured one's noise would stand on both sides.
        acting: The measured torque after the drives' signals, N m, (m, n) per part.
        unexplained: What of it the fit does not predict, N m, (m, n) per part.
        alike: A state whose joints are taken to bear the same; None: what the fit says.
        learned: The state of logs that a motion which nobody has made yet is imagined from; None: this is of logs.
        lacking: States without one of its causes that were asked for.
    """

    problem: Problem
    causes: tuple[Cause, ...]
    fit: Fit
    rig: Rig
    torque: list[Array]
    acting: list[Array]
    unexplained: list[Array]
    alike: State | None = None
    learned: State | None = None
    lacking: dict[Cause, State] = field(default_factory=dict, init=False, repr=False)

    __repr__ = brief

    @cached_property
    def stand(self) -> Stand:
        """The rig that a further change turns; without one of its causes a fit's inertias are no rig's that turns."""
        return build_stand((self.alike or self).rig, self.causes)

    @cached_property
    def load(self) -> Load:
        """What effects read of it; without one of its causes a fit takes inertias for what that one bears."""
        known = self.alike or self
        borne = self.torque if self.learned is not None else known.torque
        return Load(self.problem.evidence, self.torque, borne, build_stand(known.rig, known.causes))

    @cached_property
    def bearing(self) -> list[Bearing]:
        """What each joint bears along each part; all that is neither inertia nor friction is the link's.

        On a motion that nobody has made the logs' fit says it, of the torque that its model asks for.
        """
        if self.alike is not None and self.learned is None:
            return self.alike.bearing
        problem = self.problem
        known = self.alike or self
        evidence = problem.evidence
        theta = known.fit.theta
        dry = [c for c in known.causes if isinstance(c, Effect) and is_motor_friction(c)]
        at = len(problem.reduction.independent)
        friction = [
            (effect, theta[at + k : at + k + 1]) for k, effect in enumerate(problem.friction)
        ]
        braked: list[Array] = [np.zeros(x.shape) for x in self.acting]
        for effect, values in [*friction, *((c, known.coefficients(c)) for c in dry)]:
            j = evidence.rig.joint_index(effect.joint)
            for brake, columns in zip(braked, problem.plain(effect, self.load)):
                brake[:, j] += columns @ values
        accelerated = zip(problem.motion.full, problem.motion.resting, problem.motion.rotors)
        inertial = [(x - y) @ theta[:at] + rotor for x, y, rotor in accelerated]
        totals = (
            self.torque if self.learned else [x - y for x, y in zip(self.acting, self.unexplained)]
        )
        loads = [total - brake - x for total, brake, x in zip(totals, braked, inertial)]
        rows = [
            (x, y, z, part.channels.tau, part.still)
            for x, y, z, part in zip(braked, loads, inertial, evidence.parts)
        ]
        return [
            [
                JointLoad.along(x[:, j], y[:, j], tau[:, j], still[:, j], z[:, j], asked)
                for (x, y, z, tau, still), asked in zip(
                    rows, problem.motion.couple_joints(j, theta[:at])
                )
            ]
            for j in range(evidence.rig.n)
        ]

    @cached_property
    def dispersion(self) -> Array:
        """Each joint's ``φ = ⟨|R(f)|²/ρ(f)⟩``, (n,): residual power over the noise's, as the drives pass it on."""
        found = self.fit.dispersion.copy()
        evidence = self.problem.evidence
        for joint in {cause.joint for cause in self.causes if isinstance(cause, Signal)}:
            j = evidence.rig.joint_index(joint)
            first = 0
            own = self.fit.residual[self.fit.rows(j)]
            power = 0.0
            fair = 0.0
            for part, share in zip(evidence.parts, self.pass_all_noise(j)):
                spectrum = np.abs(fft.rfft(own[first : first + part.rows])) ** 2
                first += part.rows
                power = power + spectrum.sum()
                fair = fair + float(np.sum(spectrum / share))
            found[j] *= fair / max(power, 1e-300)
        return found

    def pass_all_noise(self, joint: int) -> list[Array]:
        """ρ at a joint, the share of a noise's power that its drive's signals pass on, (f,) for each part."""
        evidence = self.problem.evidence
        shares: list[Array] = [np.ones(part.whitener.shape[1]) for part in evidence.parts]
        for signal in self.causes:
            if isinstance(signal, Signal) and evidence.rig.joint_index(signal.joint) == joint:
                shares = [before * own for before, own in zip(shares, self.pass_noise(signal))]
        return shares

    def pass_noise(self, signal: Signal, bearing: Bearing | None = None) -> list[Array]:
        """Share of a noise's power that a drive's signal passes on, (f,) for each part; see `bearing_for`.

        A small noise of the estimated spectrum is put beside the measured torque: for a filter the share is its gain. A
        limit below nearly all that was measured leaves a constant, in which no noise is left: that explains nothing.
        What of the noise comes through the acceleration passes what is `felt` of the joint's own inertia.
        """
        evidence = self.problem.evidence
        joint = self.problem.evidence.rig.joint_index(signal.joint)
        known = bearing or self.bearing_for(signal, self.acting)
        borne: Sequence[JointLoad | None] = known or [None] * len(evidence.parts)
        shares: list[Array] = []
        for part, noises, load in zip(evidence.parts, self.noise, borne):
            noise = noises[:, joint]
            torque = part.channels.tau[:, joint]
            used, less = (part.acted(signal, x, joint, load) for x in (torque, torque - noise))
            every = [torque, noise, used, used - less]
            if signal.springy:
                every.append(signal.felt(np.zeros((len(noise), 1)), noise[:, None], part.dt)[:, 0])
            power = average_power(part.transform(np.stack(every).T, joint))
            share = np.minimum(ratio(power[3], power[1]), ratio(power[2], power[0]))
            if signal.springy:
                shaken = np.minimum(part.shaken[joint] * part.whitener[joint] ** 2, 1.0)[
                    : len(share)
                ]
                share += shaken * (ratio(power[4], power[1]) - share)
            shares.append(np.pad(share, (0, part.whitener.shape[1] - len(share)), mode="edge"))
        return shares

    @cached_property
    def noise(self) -> list[Array]:
        """Noise with the phases of what is unexplained and the spectrum that whitening makes flat, N m, (m, n) each."""
        return [
            imitate_noise(part, left)
            for part, left in zip(self.problem.evidence.parts, self.unexplained)
        ]

    def columns(
        self, cause: Cause, torque: list[Array] | None = None, bearing: Bearing | None = None
    ) -> Columns:
        """What a cause would add; a drive's signal acts on these torques, N m, (m, n) per part, or on `acting`."""
        bearing = bearing or self.bearing_for(cause, self.acting)
        acts_on = self.acting if torque is None else torque
        return build_columns(self.problem.evidence, cause, self.stand, self.load, acts_on, bearing)

    def bearing_for(self, cause: Cause, torque: list[Array]) -> Bearing | None:
        """What a cause's joint bears, where the cause asks; `torque`: what it acts on, N m, (m, n) per part."""
        if not isinstance(cause, Signal) or not cause.geared:
            return None
        if cause.springy:
            return self.sprung(cause, torque)
        return self.bearing[self.problem.evidence.rig.joint_index(cause.joint)]

    def sprung(self, spring: Signal, torque: list[Array]) -> Bearing:
        """What a joint bears whose link swings; all that is not of the rigid model stands before the spring."""
        evidence = self.problem.evidence
        j = self.problem.evidence.rig.joint_index(spring.joint)
        if self.learned is None:
            (beta, phi) = self.swung(spring, torque)
            (loads, own) = self.problem.motion.apart[j]
        else:
            beta, phi = self.learned.swung(spring, self.learned.acting)
            loads, own = self.problem.motion.split_columns(j, self.learned.problem.motion.felt[j])
        brakes = [np.zeros(len(x)) for x in loads]
        for effect, value in zip(self.problem.friction, phi):
            if effect.joint == spring.joint:
                columns = self.problem.plain(effect, self.load)
                brakes = [brake + x[:, 0] * value for brake, x in zip(brakes, columns)]
        inertial = [x @ beta + rotor[:, j] for x, rotor in zip(own, self.problem.motion.rotors)]
        rows = zip(brakes, loads, inertial, torque, evidence.parts)
        return [
            JointLoad.along(x, y @ beta, tau[:, j], part.still[:, j], z)
            for x, y, z, tau, part in rows
        ]

    def swung(self, spring: Signal, torque: list[Array]) -> tuple[Array, Array]:
        """``argmin ‖τ - felt(0, I_a a) - felt(load, inertial) β - friction φ - ringing c‖``: β, (b,), and φ, (f,).

        A resonance takes the rigid model's parameters far from what they are, so they are fitted with the spring in.

        Args:
            spring: The spring.
            torque: Torques, N m, (m, n) per part.
        """
        evidence = self.problem.evidence
        n = len(self.fit.scale)
        j = evidence.rig.joint_index(spring.joint)
        at = len(self.problem.reduction.independent)
        beside = self.fit.stack[j::n, at:] / self.fit.scale[j]
        rows = [*zip(evidence.parts, *self.problem.motion.apart[j])]
        felt = [spring.felt(load, inertial, part.dt) for part, load, inertial in rows]
        swings = [spring.swings(part.dt, len(load)) for part, load, _ in rows]
        # Every part begins with a swing of its own.
        begun = [
            np.hstack([x if k == i else 0 * x for i in range(len(swings))])
            for k, x in enumerate(swings)
        ]
        columns = np.hstack([evidence.whiten(felt, j), beside, evidence.whiten(begun, j)])
        rotors = [x[:, [j]] for x in self.problem.motion.rotors]
        known = [spring.felt(0 * x, x, part.dt)[:, 0] for x, part in zip(rotors, evidence.parts)]
        target = evidence.whiten([x[:, j] - y for x, y in zip(torque, known)], j)
        found = np.linalg.lstsq(columns, target, rcond=1e-10)[0]
        b = felt[0].shape[1]
        return found[:b], found[b : b + beside.shape[1]]

    def coefficients(self, cause: Cause) -> Array:
        """Fitted coefficients of a chosen torque or rig effect."""
        return self.fit.theta[self.places(cause)]

    def places(self, cause: Cause) -> slice:
        """Where they stand in theta."""
        at = len(self.fit.theta) - sum(width(c) for c in self.causes)
        for other in self.causes:
            if other is cause:
                return slice(at, at + width(other))
            at += width(other)
        raise ValueError(f"{cause.name} was not chosen")


def average_power(spectrum: Array) -> Array:
    """Mean power of some spectra, (k, f), over each few frequencies inside the band, (k, f')."""
    inside = int(UNFADED_SHARE * spectrum.shape[1]) // AVERAGED_FREQUENCIES * AVERAGED_FREQUENCIES
    return np.asarray(
        np.mean(
            np.abs(spectrum[:, :inside].reshape(len(spectrum), -1, AVERAGED_FREQUENCIES)) ** 2,
            axis=2,
        )
    )


def ratio(after: Array, before: Array) -> Array:
    """Share of one mean power that another has, at each frequency inside the band."""
    # What is passed on by several signals is a product: of 1e-300 twice nothing is left to divide by.
    return np.repeat(np.clip(after / np.maximum(before, 1e-300), 1e-30, 1.0), AVERAGED_FREQUENCIES)


def imitate_noise(part: LogStretch, left: Array) -> Array:
    """Torques with the phases of others, (m, n), and with the spectra that whitening makes flat."""
    spectrum = fft.rfft(left, axis=0)
    gain = part.whitener.T
    size = np.zeros(spectrum.shape)
    size[: len(gain)] = np.divide(
        1.0, gain, out=np.zeros_like(gain), where=gain > 1e-3 * gain.max(axis=0)
    )
    return np.asarray(
        fft.irfft(spectrum / np.maximum(np.abs(spectrum), 1e-300) * size, len(left), axis=0)
    )


def width(cause: Cause) -> int:
    """Coefficients that a cause adds to theta."""
    return (
        len(cause.coefficients) if isinstance(cause, Effect) else int(isinstance(cause, RigEffect))
    )


def solve_causes(
    problem: Problem, causes: Sequence[Cause], before: State | None = None, keep: bool = False
) -> State:
    """Refit everything with these causes.

    Args:
        problem: The logs.
        causes: The causes.
        before: A state to take the model's torque from, which loaded causes read.
        keep: Keep its weights too, and what its joints bear, so that sums of squares can be compared.
    """
    evidence = problem.evidence
    rig = before.rig if before else evidence.rig
    load = before.load if before else Load(evidence, evidence.torque, evidence.torque, Stand(rig))
    acting = evidence.torque
    for cause in causes:
        if isinstance(cause, Signal):
            acting = apply_signal(
                evidence, cause, acting, before.bearing_for(cause, acting) if before else None
            )
    b = evidence.whiten_all([x - rotor for x, rotor in zip(acting, problem.motion.rotors)])
    effects = [*problem.friction, *(c for c in causes if not isinstance(c, Signal))]
    built = (problem.build(c, build_stand(rig, causes, c), load, acting) for c in effects)
    A = np.concatenate([problem.rigid, *built], axis=2)
    now = fit(
        A,
        b,
        evidence.used,
        evidence.block,
        before.fit.scale if before and keep else None,
        problem.luck,
    )
    total = predict_torque(problem, effects, now.theta, load)
    unexplained: list[Array] = [y - x for x, y in zip(total, acting)]
    rig = refit_rig(problem, now.theta)
    alike = before if keep else None
    return State(problem, tuple(causes), now, rig, total, acting, unexplained, alike)


def apply_signal(
    evidence: Evidence, signal: Signal, torque: list[Array], bearing: Bearing | None
) -> list[Array]:
    """Let a drive's signal act on the torques of its joint."""
    j = evidence.rig.joint_index(signal.joint)
    borne = [None] * len(torque) if bearing is None else bearing
    return [x - part.lost(signal, x, j, y) for part, x, y in zip(evidence.parts, torque, borne)]


def refit_rig(problem: Problem, theta: Array) -> Rig:
    """Return the rig with the fitted base parameters."""
    rig = problem.evidence.rig
    reduction = problem.reduction
    phi = rig.phi.copy()
    phi[find_base_columns(rig, reduction)] += theta[: len(reduction.independent)] - given_beta(
        rig, reduction
    )
    return rig.with_phi(phi)


def predict_torque(
    problem: Problem, effects: Sequence[Cause], theta: Array, load: Load
) -> list[Array]:
    """The model's total torque at full rate, N m, (m, n) per part."""
    width_ = len(problem.reduction.independent)
    out: list[Array] = [
        x @ theta[:width_] + y for x, y in zip(problem.motion.full, problem.motion.rotors)
    ]
    at = width_
    for effect in effects:
        size = width(effect)
        if isinstance(effect, Effect):
            j = problem.evidence.rig.joint_index(effect.joint)
            for total, x in zip(out, problem.plain(effect, load)):
                total[:, j] += x @ theta[at : at + size]
        at += size
    return out


def is_near(new: Array, old: Array, share: float) -> bool:
    """Whether two torques differ by less than a share of their size."""
    return float(np.linalg.norm(new - old)) <= share * float(np.linalg.norm(old))


def solve_consistently(state: State) -> State:
    """Solve again until what a cause is built from is what the fit has found.

    A loaded cause reads the torque that it is itself a part of; a turned rig's torque bends with how far it is turned.
    """
    for _ in range(SETTLING_PASSES):
        causes = tuple(aim_turn(state, cause) for cause in state.causes)
        if not any(reads_fit(cause) for cause in causes):
            break
        before = state
        state = solve_causes(state.problem, causes, state)
        settled = (
            is_near(new, old, SETTLED_CHANGE) for new, old in zip(state.torque, before.torque)
        )
        if (
            causes == before.causes
            and all(settled)
            and is_near(state.fit.dispersion, before.fit.dispersion, FITTED)
        ):
            break
    return state


def reads_fit(cause: Cause) -> bool:
    """Whether what a cause is built from changes with what is fitted: a torque, or inertias that are turned by much."""
    if isinstance(cause, RigEffect):
        return cause.angle >= BENT
    return (isinstance(cause, Effect) and cause.loaded) or (
        isinstance(cause, Signal) and cause.geared
    )


def build_stand(rig: Rig, causes: Sequence[Cause], before: Cause | None = None) -> Stand:
    """Return the rig with the causes' large turns, or with those of them that come `before` one: pitch before roll."""
    turns = [cause for cause in causes if isinstance(cause, RigEffect)]
    turns.sort(key=lambda cause: [getattr(cause, s.name) != 0 for s in cause.shapes])
    first = turns[: next((k for k, cause in enumerate(turns) if cause is before), len(turns))]
    return Stand(rig, tuple(cause for cause in first if cause.angle >= BENT))


def aim_turn(state: State, cause: Cause) -> Cause:
    """Return a change of the rig at the size that was fitted, where its torque is no more in proportion to it."""
    if not isinstance(cause, RigEffect):
        return cause
    value = float(state.coefficients(cause)[0])
    if value == 0:  # nothing of it shows: a change of no size at all has no direction either
        return cause
    other = resize(cause, value)
    if (
        abs(value - get_magnitude(cause)) < AIMED * abs(value)
        or max(cause.angle, other.angle) < BENT
    ):
        return cause
    return other


def resize(cause: RigEffect, value: float) -> RigEffect:
    """Return a rig effect with its one shape parameter that is not zero set to a value within its bounds."""
    shape = next(s for s in cause.shapes if getattr(cause, s.name))
    return cause.altered(**{shape.name: value})


def refit_without(state: State, cause: Cause) -> State:
    """Refit without a cause, the joints weighted as before."""
    return solve_causes(
        state.problem, tuple(c for c in state.causes if c is not cause), state, keep=True
    )
