"""Causes in the bodies of a rig, fitted to what sets the refitted base parameters apart from the given ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from gimbal_pin.diagnosis.difference import RANK, Difference
from gimbal_pin.effects import Cause, RigEffect
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
ENTER = 1e-4
"""Chance, over the whole list, from which a cause does not enter."""
PENALTY = 4.0
"""Gain that a free parameter makes by luck."""
PASSES = 8
PARTS = (1.0, 0.5, 0.2, 0.05)
"""Parts of a step that are tried: far from the given figures its slopes point too far."""
FINER = (1.8, 1.35, 1.16, 1.08)
"""Factors by which a profiled size is refined in turn."""
MOST = 4
"""Most causes that are composed."""
UNEXPLAINED = 0.2
"""Share of the difference that may be left, or no name deserves trust."""


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
    def sizes(self) -> tuple[str, ...]:
        """Those of the fixed ones that are not zero: they are profiled."""
        return tuple(name for name, value in self.fixed if value)

    def at(self, values: Sequence[float]) -> RigEffect:
        """Return the cause with these figures, as far as its bounds allow."""
        inside = {s.name: float(np.clip(x, s.lower, s.upper)) for x, s in zip(values, self.free)}
        place = {"joint": self.joint} if self.of.of_joint else {}
        return self.of(**place, **inside, **dict(self.fixed))

    def times(self, factor: float) -> Kind:
        """Return it with what is profiled so many times as large."""
        return self._replace(fixed=tuple((name, factor * value) for name, value in self.fixed))


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

    def std(self, kind: Kind) -> Array:
        """Standard deviations of a kind's figures, (p,); nan where nothing is shown."""
        i = self.kinds.index(kind)
        first = sum(len(x) for x in self.values[:i])
        power = np.diag(self.covariance)[first : first + len(self.values[i])]
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
    def inverse(self) -> tuple[Array, Array, Array]:
        """Base columns over poses that show all, (m, b), their pseudo-inverse, and the given rig's torque, (m,)."""
        rig, motion = self.found.rig, samples(self.found.rig)
        places = columns_of(rig, self.found.reduction)
        columns = regressor(rig, *motion)[:, :, places].reshape(-1, len(places))
        return columns, np.linalg.pinv(columns), rnea(rig, *motion).ravel()

    def response(self, rig: Rig) -> tuple[Array, float]:
        """Base parameters that give the given rig the torques of another, less its own, and the share they cannot."""
        columns, inverse, before = self.inverse
        torque = rnea(rig, *samples(rig)).ravel() - before
        change = inverse @ torque
        return change, float(np.linalg.norm(torque - columns @ change) / max(float(np.linalg.norm(torque)), 1e-300))

    def slope(self, kind: Kind) -> Slope | None:
        """Central differences of `response`; None if the base parameters cannot say what the kind does."""
        if kind not in self.slopes:
            self.slopes[kind] = self.computed(kind, self.found.rig)
        return self.slopes[kind]

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

    def fitted(self, kinds: Sequence[Kind]) -> Fitted | None:
        """Fit kinds together by Gauss and Newton; None where no body allows what they would need."""
        found = self.found
        slopes = [slope for kind in kinds if (slope := self.slope(kind)) is not None]
        gain, freedom = self.solver(slopes)
        values: list[Array] = [np.zeros(len(kind.free)) for kind in kinds]
        start = self.made(kinds, values)
        if start is None:
            return None
        response = start
        for _ in range(PASSES):
            step = np.split(gain @ (found.change - response), np.cumsum([len(x) for x in values])[:-1])
            better = self.nearer(kinds, values, step, self.cost(found.change - response))
            if better is None:
                break
            values, response = better
        if not all(kind.at(x.tolist()).plausible(found.rig) for kind, x in zip(kinds, values)):
            return None
        freedom += sum(len(kind.sizes) for kind in kinds)
        cost = self.cost(found.change - response)
        return Fitted(tuple(kinds), tuple(values), gain @ found.covariance @ gain.T, response, cost, freedom)

    def made(self, kinds: Sequence[Kind], values: Sequence[Array]) -> Array | None:
        """Change in base parameters that kinds with these figures make, (b,); None where no body allows them."""
        try:
            return self.response(altered(self.found.rig, kinds, values))[0]
        except UsageError:
            return None

    def nearer(
        self, kinds: Sequence[Kind], values: Sequence[Array], step: Sequence[Array], cost: float
    ) -> tuple[list[Array], Array] | None:
        """Go a step, or a part of it, to where less is left; None where no part leaves less."""
        for part in PARTS:
            new = [x + part * dx for x, dx in zip(values, step)]
            response = self.made(kinds, new)
            if response is not None and self.cost(self.found.change - response) < cost:
                return new, response
        return None

    def best(self, rest: Sequence[Kind], kinds: Sequence[Kind]) -> Fitted | None:
        """Fit one of some forms of a cause beside others, the form that leaves least, its profiled sizes refined."""
        found = [(one.cost, one, kind) for kind in kinds if (one := self.fitted([*rest, kind])) is not None]
        if not found:
            return None
        _, fit, kind = min(found, key=lambda row: row[0])
        for factor in FINER if kind.sizes else ():
            for other in (kind.times(factor), kind.times(1 / factor)):
                new = self.fitted([*rest, other])
                if new is not None and new.cost < fit.cost:
                    fit, kind = new, other
        return fit

    def solver(self, slopes: Sequence[Slope]) -> tuple[Array, int]:
        """Weighted pseudo-inverse over the directions that are shown, (p, b), and how many there are."""
        W = self.found.whitener
        unit = np.concatenate([slope.unit for slope in slopes])
        left, size, right = np.linalg.svd(W @ np.hstack([s.columns for s in slopes]) * unit, full_matrices=False)
        shown = size > max(float(np.sqrt(self.found.inflation)), RANK * float(size.max(initial=0.0)))
        inverse = (right[shown].T / size[shown]) @ left[:, shown].T @ W
        return unit[:, None] * inverse, int(shown.sum())


def altered(rig: Rig, kinds: Sequence[Kind], values: Sequence[Array]) -> Rig:
    """Return the rig with causes of these kinds and figures in it; `UsageError` where no body allows them."""
    for kind, x in zip(kinds, values):
        rig = kind.at(x.tolist()).apply(rig)
    return rig


def kinds_of(rig: Rig, causes: Mapping[str, type[Cause]]) -> list[list[Kind]]:
    """Causes in the bodies, each in its forms: those of the given model, and what may be mistaken for them."""
    every = [kind for kind in causes.values() if issubclass(kind, RigEffect)]
    places = [(kind, joint) for kind in every for joint in (rig.joints if kind.of_joint else rig.joints[:1])]
    return [[Kind(kind, joint, tuple(held.items())) for held in kind.forms(rig)] for kind, joint in places]


def chosen(bodies: Bodies, causes: Mapping[str, type[Cause]]) -> tuple[Fitted, list[list[Kind]]]:
    """Compose causes until none is worth its parameters; return the fit, and all that could be tried."""
    shown = [[kind for kind in forms if bodies.slope(kind) is not None] for forms in kinds_of(bodies.found.rig, causes)]
    tried = [forms for forms in shown if forms]
    none = now = bodies.nothing()
    while len(now.kinds) < MOST:
        others = [
            bodies.best(now.kinds, forms) for forms in tried if not any(same(forms[0], kind) for kind in now.kinds)
        ]
        worth = [(net(now, one), one) for one in others if one is not None and chance(now, one) * len(tried) < ENTER]
        if not worth:
            break
        now = max(worth, key=lambda row: row[0])[1]
    freedom = len(bodies.found.change)
    unexplained = now.cost - freedom > UNEXPLAINED * max(none.cost - freedom, 0.0)
    return none if unexplained else now, tried


def same(a: Kind, b: Kind) -> bool:
    """Whether two are forms of one cause at one place."""
    return (a.of, a.joint) == (b.of, b.joint)


def chance(less: Fitted, more: Fitted) -> float:
    """Chance of the gain from one fit to a larger one if there is nothing, in units of what the larger one leaves.

    What no body explains, a gyro's bias or a clock, is far above the sensors' noise on a good log, and any cause
    that is added takes up a part of it (quasi-likelihood: McCullagh and Nelder 1989, section 4.5).
    """
    freedom, left = more.freedom - less.freedom, max(len(more.response) - more.freedom, 1)
    return float(chi2.sf((less.cost - more.cost) / max(1.0, more.cost / left), freedom)) if freedom > 0 else 1.0


def net(less: Fitted, more: Fitted) -> float:
    """Gain less what as many free parameters gain by luck."""
    return less.cost - more.cost - PENALTY * (more.freedom - less.freedom)
