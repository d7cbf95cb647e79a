"""A spring's shape and the rigid model, fitted together with the link where it swings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.fit import Fit, fit
from gimbal_pin.diagnosis.leftover import MUCH
from gimbal_pin.diagnosis.links import Link, carried, swung
from gimbal_pin.diagnosis.shapes import TOLD, shape_names
from gimbal_pin.diagnosis.state import State, left, refitted, solved, without
from gimbal_pin.effects.sprung import SHARE, Sprung
from gimbal_pin.log import Array
from gimbal_pin.regressor import regressor
from gimbal_pin.rows import columns_of

FIRST, ROUNDS = 4, 2
"""Rounds in which the model and the link's motion, each worked out from the other, come to agree: at first, and from
shapes that are near."""
EVALUATIONS = 6
"""Most steps of the shapes' least squares, twice: what is left at each joint weighs it the second time."""
STEP = 1e-4
"""Step of their derivatives, in logarithms."""
USUAL = 1.0
"""How far a rotor's share usually is from `SHARE`, in logarithms: a log that shows the link's swing alone does not tell
it, and without that the other shapes would follow it to their bounds."""
LOWEST = 1e-3
"""Least rotor's share that is fitted, and share of a first hardening."""
LEAST, MOST = 0.05, 0.6
"""Rotor's shares between which the fit begins."""
QUIET = 1.0
"""Dispersion up to which nothing is left that a link's motion could explain."""
HARDER, DAMPED = 0.1, 0.2
"""Mean ``h z²`` and damping with which the fit of a spring that hardens begins."""
FITS, ENOUGH = 4, 0.01
"""Most rounds of that, and the fall of what is left under which another is none: it begins farther off."""
CLEAR = 2.0
"""Vuong's z from which it is told from a linear spring."""
FAR = 1e3
"""Residual of shapes with which the link has no motion."""


class Agreed(NamedTuple):
    """A model and a link's motion that agree.

    Attributes:
        fit: The fit with the rigid columns at the link's motion.
        theta: Coefficients of the rigid model and of what stands beside it.
        begun: How much the link swings in its own ways since each part began, (parts, 2).
        links: The link along each part; none yet.
    """

    fit: Fit
    theta: Array
    begun: Array
    links: tuple[Link, ...] = ()


def linked(state: State, again: bool = False) -> State:
    """Work out where each spring's link swings, as far as that leaves less than a spring at the encoder's angle.

    Args:
        state: Causes found, springs among them.
        again: Those too that have been worked out, from where they are.
    """
    for cause in state.causes:
        if not isinstance(cause, Sprung) or not cause.springy or np.max(state.fit.dispersion) <= QUIET:
            continue
        if again or cause not in state.swings:
            state = worked_out(state, cause)
    return state


def worked_out(state: State, spring: Sprung) -> State:
    """The state with a spring's link where it swings, its shape refitted; as it was if that leaves no less.

    Where a linear spring leaves much it is tried whether one that hardens leaves less.
    """
    here = Swinging(state, spring)
    near = usual(spring)
    start = here.agree(near, here.unknown, state.fit.scale, FIRST)
    if start is None:
        return state
    best, agreed = here.fitted(*here.fitted(near, start))
    after = min(state, here.taken(best, agreed), key=left)
    if spring.hardening or np.max(after.fit.dispersion) <= MUCH:
        return after
    hard = here.hardened(best, agreed)
    return after if hard is None or not parted(hard[1].fit, agreed.fit) else min(after, here.taken(*hard), key=left)


def parted(hard: Fit, even: Fit) -> bool:
    """Whether the blocks of time tell a spring that hardens from a linear one: Vuong's test, for one shape more."""
    over = even.residual.reshape(-1, len(even.scale)) / even.scale * hard.scale
    gains = hard.by_block((over.ravel() ** 2 - hard.residual**2)[:, None])[:, 0]
    spread = float(np.std(gains) * np.sqrt(len(gains)))
    return float(gains.sum()) - 2 > max(TOLD, CLEAR * spread)


def usual(spring: Sprung) -> Sprung:
    """The spring with the same zero, and a rotor's share such as rotors have: at the encoder's angle it goes astray."""
    share = min(max(spring.rotor_share, LEAST), MOST)
    other = spring.moved("frequency", spring.frequency * (spring.rotor_share / share) ** 0.5)
    return other if isinstance(other, Sprung) else spring


@dataclass(frozen=True, eq=False)
class Swinging:
    """A spring whose link is worked out.

    Attributes:
        state: A state with the spring.
        spring: The spring in it.
    """

    state: State
    spring: Sprung

    @cached_property
    def acting(self) -> list[Array]:
        """What acts but for the spring, N m, (m, n) per part."""
        return without(self.state, self.spring).acting

    @cached_property
    def beside(self) -> Array:
        """Whitened columns of all that stands beside the rigid model, (rows, n, k)."""
        fitted, at = self.state.fit, len(self.state.problem.reduction.independent)
        return (fitted.stack.reshape(-1, len(fitted.scale), len(fitted.theta)) / fitted.scale[:, None])[:, :, at:]

    @cached_property
    def unknown(self) -> Agreed:
        """The state's own fit, with nothing known of the link."""
        return Agreed(self.state.fit, self.state.fit.theta, np.zeros((len(self.state.acting), 2)))

    @cached_property
    def places(self) -> Array:
        """Where the base parameters stand in `Rig.phi`, (b,)."""
        return columns_of(self.state.problem.evidence.rig, self.state.problem.reduction)

    def taken(self, best: Sprung, agreed: Agreed) -> State:
        """The state with what was worked out of the spring."""
        state = self.state
        causes = tuple(best if cause is self.spring else cause for cause in state.causes)
        others = {cause: taken for cause, taken in state.swings.items() if cause is not self.spring}
        taken = [link.asked for link in agreed.links]
        return solved(state.problem, causes, replace(state, swings={**others, best: taken}))

    def hardened(self, even: Sprung, known: Agreed) -> tuple[Sprung, Agreed] | None:
        """Fit a spring that hardens a little at first, from the linear one that is nearest; None: it has no motion.

        A linear spring bends its damping and its rotor's share to what hardening does: they begin where they are usual.
        """
        zero = even.frequency * np.sqrt(even.rotor_share / SHARE)
        even = even.altered(frequency=zero, damping=DAMPED, rotor_share=SHARE)
        agreed = self.agree(even, self.unknown, None, FIRST)
        if agreed is None:
            return None
        power = np.mean(np.concatenate([link.soft for link in agreed.links]) ** 2)
        softer = 1 / np.sqrt(1 + 3 * HARDER)
        start = even.altered(frequency=zero * softer, hardening=HARDER / (softer**4 * power))
        agreed = self.agree(start, agreed._replace(begun=0 * agreed.begun, links=()), None, FIRST)
        if agreed is None:
            return None
        for _ in range(FITS):
            before, (start, agreed) = agreed, self.fitted(start, agreed)
            if agreed.fit.left > min(known.fit.left, before.fit.left - ENOUGH):
                break
        return start, agreed

    def fitted(self, start: Sprung, known: Agreed) -> tuple[Sprung, Agreed]:
        """Least squares over the logarithms of the shapes, from a start and what agrees with it."""
        from scipy.optimize import least_squares

        least = {"hardening": LOWEST * start.hardening}
        bounds = {x.name: (max(x.lower, least.get(x.name, LOWEST)), x.upper) for x in start.shapes}
        names = shape_names(start)
        low, high = np.log([bounds[name] for name in names]).T

        def shaped(x: Array) -> Sprung:
            return start.altered(**dict(zip(names, np.exp(x).tolist())))

        def residual(x: Array) -> Array:
            agreed = self.agree(shaped(x), known, known.fit.scale)
            far = np.full(len(known.fit.target), FAR) if agreed is None else agreed.fit.residual
            return np.append(far, (x[names.index("rotor_share")] - np.log(SHARE)) / USUAL)

        x = np.clip(np.log([getattr(start, name) for name in names]), low + STEP, high - STEP)
        best = shaped(least_squares(residual, x, bounds=(low, high), diff_step=STEP, max_nfev=EVALUATIONS).x)
        agreed = self.agree(best, known, None)
        return (start, known) if agreed is None else (best, agreed)

    def agree(self, shape: Sprung, known: Agreed, scale: Array | None, rounds: int = ROUNDS) -> Agreed | None:
        """Fit the model at the link's motion, then the motion by the model, and again.

        At its own joint the link's motion follows the model as on a spring at the encoder's angle, exactly but for the
        pose; the rest of it, and what other joints feel, is taken as the last model has it.

        Args:
            shape: The spring's shape.
            known: What agreed with a shape near it.
            scale: Weights of the joints; None: by what is left.
            rounds: How often.

        Returns:
            None where the link has no motion about its motor.
        """
        problem, evidence = self.state.problem, self.state.problem.evidence
        at, j = len(problem.reduction.independent), evidence.rig.joint_index(shape.joint)
        loads, inertials = problem.apart[j]
        for _ in range(rounds):
            rig, links = refitted(problem, known.theta), list[Link]()
            for k, part in enumerate(evidence.parts):
                link = swung(rig, part, shape, known.begun[k], known.links[k].motion if known.links else None)
                if link is None:
                    return None
                links.append(link)
            rows = zip(links, loads, inertials, evidence.parts)
            felt = [shape.even(link.soft).felt(x, y, part.dt) for link, x, y, part in rows]
            columns, target = [], []
            for k, (part, link) in enumerate(zip(evidence.parts, links)):
                full = regressor(evidence.rig, *carried(part, j, link.motion), part.platform)[:, :, self.places]
                full[:, j] = problem.rigid_full[k][:, j]
                full[:, j, problem.felt[j]] = felt[k]
                # Every part begins with a swing of its own.
                free = np.zeros((*full.shape[:2], known.begun.size))
                free[:, :, 2 * k : 2 * k + 2] = link.ways
                columns.append(np.concatenate([full, free], axis=2))
                rest = (full - problem.rigid_full[k]) @ known.theta[:at] + link.ways @ known.begun[k]
                target.append(self.acting[k] - link.asked + rest)
            A, b = (evidence.whiten_all(rows) for rows in (columns, target))
            now = fit(np.concatenate([A, self.beside], axis=2), b, evidence.used(), evidence.block, scale)
            rigid, begun, others = np.split(now.theta, [at, at + known.begun.size])
            begun = begun.reshape(-1, 2)
            if shape.hardening:
                # A swing that has died away before the log counts is not told, and what is large is not small for long.
                most = np.array([np.max(np.abs(link.motion.q)) for link in links])
                begun *= np.minimum(1.0, most / np.maximum(np.hypot(*begun.T), 1e-300))[:, None]
            known = Agreed(now, np.concatenate([rigid, others]), begun, tuple(links))
        return known
