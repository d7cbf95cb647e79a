"""Causes in the bodies of a rig, fitted to what sets the refitted base parameters apart from the given ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.difference import RANK, Difference
from gimbal_pin.effects import RigEffect
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter
from gimbal_pin.reduction import samples
from gimbal_pin.regressor import regressor, rnea
from gimbal_pin.rig import Rig
from gimbal_pin.rows import columns_of

STEP = 1e-3
"""Step for slopes, as a share of a parameter's range; a tenth of it, and so on, where no body allows that."""
PLACES = 5
"""How many times it is tried smaller."""
WORTH = 10.0
"""Steps that a parameter's standard deviation may have, or it counts as not shown."""
PENALTY = 4.0
"""Gain that a free parameter makes by luck."""
NEXT = 1e-6
"""Figures, m or rad, next to none: a weight without a place is spread, one with a place is bolted on."""
PASSES = 30
PARTS = (1.0, 0.5, 0.2, 0.05)
"""Parts of a step that are tried: far from where they were taken its slopes point too far."""
GAINED = 1e-4
"""Share of what is left; a pass that gains less is the last."""
STARTS = 3
"""Profiled sizes, those that leave least, from which a size is freed."""


class Kind(NamedTuple):
    """A cause without its figures: its class, its joint, and what is held fixed of it."""

    of: type[RigEffect]
    joint: str
    fixed: tuple[tuple[str, float], ...] = ()

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The shape parameters that are fitted."""
        held = dict(self.fixed)
        return tuple(shape for shape in self.of.shapes if shape.name not in held)

    @property
    def profiled(self) -> bool:
        """Whether a figure that is not zero is held fixed: a size that is free with the rest in the end."""
        held = dict(self.fixed)
        return any(held.get(shape.name) for shape in self.of.shapes)

    @property
    def start(self) -> Array:
        """Figures from which it is fitted, (p,): none at all, or next to none of what makes a profiled form differ."""
        return np.full(len(self.free), NEXT if self.profiled else 0.0)

    def at(self, values: Sequence[float]) -> RigEffect:
        """Return the cause with these figures, as far as its bounds allow."""
        place = {"joint": self.joint} if self.of.of_joint else {}
        figures = {shape.name: float(x) for x, shape in zip(values, self.free)}
        return self.of.inside(**place, **figures, **dict(self.fixed))

    def stepped(self, values: Array, step: Array) -> Array:
        """Figures after a step of a fit, (p,)."""
        return values + step if self.fixed else self.of.stepped(values, step)

    def freed(self, values: Array) -> tuple[Kind, Array]:
        """Return it with nothing held fixed, and all its figures, (p,), from those that were free."""
        held = {**dict(self.fixed), **dict(zip((shape.name for shape in self.free), values.tolist()))}
        return self._replace(fixed=()), np.array([held[shape.name] for shape in self.of.shapes])


class Slope(NamedTuple):
    """Base parameters per unit of a kind's parameters at a rig, (b, p), and the unit, (p,), they are counted in."""

    columns: Array
    unit: Array


@dataclass(frozen=True, eq=False)
class Fitted:
    """Some kinds, fitted together to a difference.

    Attributes:
        kinds: The kinds.
        values: Their figures, one array per kind.
        covariance: Of all of them, in order.
        response: The change in base parameters that they make, (b,).
        cost: What they leave, whitened and over the inflation.
        freedom: How many directions of their parameters are shown.
    """

    kinds: tuple[Kind, ...]
    values: tuple[Array, ...]
    covariance: Array
    response: Array
    cost: float
    freedom: int

    def cause(self, kind: Kind) -> RigEffect:
        """Return a kind with its fitted figures."""
        return kind.at(self.values[self.kinds.index(kind)].tolist())

    def begun(self, kinds: Sequence[Kind]) -> list[Array]:
        """Where a fit of some kinds begins: at the figures that this one has of them."""
        return [self.values[self.kinds.index(kind)] if kind in self.kinds else kind.start for kind in kinds]

    def plausible(self, rig: Rig) -> bool:
        """Whether a rig could be so."""
        return all(kind.at(x.tolist()).plausible(rig) for kind, x in zip(self.kinds, self.values))

    @property
    def profiled(self) -> bool:
        """Whether a size is held where it was profiled."""
        return any(kind.profiled for kind in self.kinds)

    @property
    def worth(self) -> tuple[float, int]:
        """What is left and what its parameters gain by luck; of equal ones, the simplest first."""
        return round(self.cost + PENALTY * self.freedom, 6), sum(len(x) for x in self.values)

    @property
    def excess(self) -> float:
        """What it leaves per direction that it does not use, as a multiple of noise; one at least.

        What no body explains, a gyro's bias or a clock, is far above the sensors' noise on a good log, and any cause
        that is added takes up a part of it (quasi-likelihood: McCullagh and Nelder 1989, section 4.5).
        """
        return max(1.0, self.cost / max(len(self.response) - self.freedom, 1))

    def std(self, kind: Kind) -> Array:
        """Standard deviations of a kind's figures, (p,), by what the fit leaves; nan where nothing is shown."""
        i = self.kinds.index(kind)
        first = sum(len(x) for x in self.values[:i])
        power = self.excess * np.diag(self.covariance)[first : first + len(self.values[i])]
        return np.where(power > 0, np.sqrt(np.maximum(power, 0.0)), np.nan)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Causes in a rig as changes of its base parameters.

    Attributes:
        found: The difference to explain.
    """

    found: Difference

    @cached_property
    def slopes(self) -> dict[Kind, Slope | None]:
        """Slopes at the given rig that have been computed."""
        return {}

    @cached_property
    def motion(self) -> tuple[Array, Array, Array]:
        """Poses that show all, with speeds and accelerations."""
        return samples(self.found.rig)

    @cached_property
    def inverse(self) -> tuple[Array, Array, Array]:
        """Base columns over poses that show all, (m, b), their pseudo-inverse, and the given rig's torque, (m,)."""
        rig, motion = self.found.rig, self.motion
        places = columns_of(rig, self.found.reduction)
        columns = regressor(rig, *motion)[:, :, places].reshape(-1, len(places))
        return columns, np.linalg.pinv(columns), rnea(rig, *motion).ravel()

    def response(self, rig: Rig) -> tuple[Array, float]:
        """Base parameters that give the given rig the torques of another, less its own, and the share they cannot."""
        if moves_alike(self.found.rig, rig):
            return self.found.responses @ (rig.phi - self.found.rig.phi), 0.0
        columns, inverse, before = self.inverse
        torque = rnea(rig, *self.motion).ravel() - before
        change = inverse @ torque
        return change, float(np.linalg.norm(torque - columns @ change) / max(float(np.linalg.norm(torque)), 1e-300))

    def slope(self, kind: Kind) -> Slope | None:
        """Central differences of `response`; None if the base parameters cannot say what the kind does."""
        if kind not in self.slopes:
            self.slopes[kind] = self.computed(kind, self.found.rig)
        return self.slopes[kind]

    def shows(self, kind: Kind) -> bool:
        """Whether the base parameters show any direction of a kind's figures."""
        slope = self.slope(kind)
        return slope is not None and self.solver([slope])[1] > 0

    def computed(self, kind: Kind, rig: Rig) -> Slope | None:
        """Compute what `slope` returns."""
        columns, units = [], []
        for k, shape in enumerate(kind.free):
            found = next(self.differences(kind, k, rig, STEP * (shape.upper - shape.lower)), None)
            if found is None or found[1] > RANK:
                return None
            columns.append(found[0])
            units.append(found[2])
        return Slope(np.stack(columns, axis=1), WORTH * np.array(units))

    def differences(self, kind: Kind, k: int, rig: Rig, step: float) -> Iterator[tuple[Array, float, float]]:
        """Yield slope, inexpressible share and step for steps that a body allows."""
        for size in (step / 10.0**i for i in range(PLACES)):
            shift = size * np.eye(len(kind.free))[k]
            try:
                (up, missed), (down, _) = (self.response(kind.at(x).apply(rig)) for x in (shift, -shift))
            except UsageError:
                continue
            yield (up - down) / (2 * size), missed if np.linalg.norm(up) > 0 else 0.0, size

    def nothing(self) -> Fitted:
        """Return the fit of no kind at all."""
        empty = np.zeros((0, 0))
        return Fitted((), (), empty, np.zeros(len(self.found.change)), self.cost(self.found.change), 0)

    def cost(self, left: Array) -> float:
        """Sum of squares of a whitened change, over the inflation."""
        return float(np.sum((self.found.whitener @ left) ** 2)) / self.found.inflation

    def fitted(self, kinds: Sequence[Kind], start: Sequence[Array] | None = None) -> Fitted | None:
        """Fit kinds together by Gauss and Newton; None where no body allows what they need."""
        found = self.found
        values = [kind.start for kind in kinds] if start is None else list(start)
        response = self.made(kinds, values)
        if response is None:
            return None
        cost = self.cost(found.change - response)
        for _ in range(PASSES):
            gain, _ = self.solver(self.slopes_at(kinds, values))
            step = np.split(gain @ (found.change - response), np.cumsum([len(x) for x in values])[:-1])
            better = self.nearer(kinds, values, step, cost)
            if better is None:
                break
            values, response = better
            before, cost = cost, self.cost(found.change - response)
            if before - cost < GAINED * max(1.0, cost):
                break
        gain, freedom = self.solver(self.slopes_at(kinds, values))
        freedom += sum(kind.profiled for kind in kinds)
        return Fitted(tuple(kinds), tuple(values), gain @ found.covariance @ gain.T, response, cost, freedom)

    def slopes_at(self, kinds: Sequence[Kind], values: Sequence[Array]) -> list[Slope]:
        """Slopes of each kind among the others, at their figures; at the given rig where no body allows a step."""
        found, rig = [], self.found.rig
        for i, kind in enumerate(kinds):
            slope = self.slope(kind)
            if slope is not None:
                steps = enumerate(slope.unit / WORTH)
                columns = [self.column(rig, kinds[i:], values[i:], k, step) for k, step in steps]
                kept = [own if new is None else new for new, own in zip(columns, slope.columns.T)]
                found.append(Slope(np.stack(kept, axis=1), slope.unit))
            rig = altered(rig, [kind], [values[i]])
        return found

    def column(self, rig: Rig, kinds: Sequence[Kind], values: Sequence[Array], k: int, step: float) -> Array | None:
        """Central difference in the k-th figure of the first of some kinds, on a rig with those before it, (b,)."""
        ends = []
        for sign in (1.0, -1.0):
            moved = values[0].copy()
            moved[k] += sign * step
            ends.append(self.made(kinds, [moved, *values[1:]], rig))
        up, down = ends
        return None if up is None or down is None else (up - down) / (2 * step)

    def made(self, kinds: Sequence[Kind], values: Sequence[Array], rig: Rig | None = None) -> Array | None:
        """Change in base parameters with kinds of these figures, (b,), from the given rig's; None where no body allows.

        They alter that rig, or another with all that comes before them.
        """
        try:
            return self.response(altered(rig or self.found.rig, kinds, values))[0]
        except UsageError:
            return None

    def nearer(
        self, kinds: Sequence[Kind], values: Sequence[Array], step: Sequence[Array], cost: float
    ) -> tuple[list[Array], Array] | None:
        """Go a step, or a part of it, to where less is left; None where no part leaves less."""
        for part in PARTS:
            new = [kind.stepped(x, part * dx) for kind, x, dx in zip(kinds, values, step)]
            response = self.made(kinds, new)
            if response is not None and self.cost(self.found.change - response) < cost:
                return new, response
        return None

    def best(
        self, rest: Sequence[Kind], kinds: Sequence[Kind], plausible: bool = True, known: Fitted | None = None
    ) -> Fitted | None:
        """Fit one of some forms of a cause beside others, the form that leaves least, all profiled sizes freed.

        The others begin afresh, and where a `known` fit has them: either may end where no step leaves less. What is not
        `plausible` with a size held may be with that free.
        """
        begun = [] if known is None or not rest else [(tuple(rest), known.begun(rest))]
        afresh = [(own, [kind.start for kind in own]) for own in product(*map(self.anew, rest))]
        fits = [self.fitted([*own, kind], [*at, kind.start]) for own, at in begun + afresh for kind in kinds]
        found = [one for one in fits if one is not None]
        profiled = sorted((one for one in found if one.profiled), key=lambda one: one.cost)[:STARTS]
        freed = [one for fit in profiled if (one := self.freed(fit)) is not None]
        likely = [one for one in [*found, *freed] if not plausible or one.plausible(self.found.rig)]
        return min(likely, key=lambda one: one.worth, default=None)

    def anew(self, kind: Kind) -> list[Kind]:
        """The first profiled size's forms, of either sign, if a kind has such or was freed from one; else itself."""
        forms = [kind._replace(fixed=tuple(held.items())) for held in kind.of.forms(self.found.rig)]
        return [form for form in forms if form.profiled and (kind.profiled or not kind.fixed)][:2] or [kind]

    def freed(self, fit: Fitted) -> Fitted | None:
        """Fit again with all profiled sizes free."""
        free = [kind.freed(x) if kind.profiled else (kind, x) for kind, x in zip(fit.kinds, fit.values)]
        return self.fitted([kind for kind, _ in free], [x for _, x in free])

    def solver(self, slopes: Sequence[Slope]) -> tuple[Array, int]:
        """Weighted pseudo-inverse over the directions that are shown, (p, b), and how many there are."""
        W = self.found.whitener
        unit = np.concatenate([slope.unit for slope in slopes])
        left, size, right = np.linalg.svd(W @ np.hstack([s.columns for s in slopes]) * unit, full_matrices=False)
        shown = size > max(float(np.sqrt(self.found.inflation)), RANK * float(size.max(initial=0.0)))
        inverse = (right[shown].T / size[shown]) @ left[:, shown].T @ W
        return unit[:, None] * inverse, int(shown.sum())


def moves_alike(a: Rig, b: Rig) -> bool:
    """Whether two rigs differ in the parameters of their bodies at most."""
    same_places = all(x.isApprox(y, 0.0) for x, y in zip(a.model.jointPlacements, b.model.jointPlacements))
    return same_places and bool(np.array_equal(a.model.gravity.linear, b.model.gravity.linear))


def altered(rig: Rig, kinds: Sequence[Kind], values: Sequence[Array]) -> Rig:
    """Return the rig with causes of these kinds and figures in it; `UsageError` where no body allows them."""
    for kind, x in zip(kinds, values):
        rig = kind.at(x.tolist()).apply(rig)
    return rig
