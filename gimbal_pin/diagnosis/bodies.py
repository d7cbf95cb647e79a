"""Which causes in a rig make up what sets the refitted base parameters apart from the given ones, and how large.

``change = response(x) + e`` over b base parameters, in which the causes' figures x use k directions up;
``s = |W e|²`` in units of the noise. What no cause explains is an error of form, as large in one direction as in
another (quasi-likelihood: McCullagh and Nelder 1989, section 4.5): ``φ = max(1, s/(b - k))``. A cause is one where it
lowers s by more than a part of such an error would: an F test, at the rate α/K of K causes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.stats import f

from gimbal_pin.diagnosis.engine.selection import BEAM, ERROR_RATE, MOST
from gimbal_pin.diagnosis.given import RANK, Difference
from gimbal_pin.dynamics.reduction import spread_states
from gimbal_pin.dynamics.regressor import compute_regressor, compute_rnea
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig.rig import Rig

STEP = 1e-6
"""Step of differences, kg, m, rad or kg m²: too small for a body to forbid, and round-off leaves eight digits."""
CLOSE, PASSES = 1e-4, 30
"""Relative fall of what is left by which a fit ends, and its most steps: what goes on beyond them fits badly."""
UNEXPLAINED = 0.2
"""Share of the difference's power that may be left, or no name deserves trust."""


class Form(NamedTuple):
    """A cause without its figures: its class, its joint, the figures that are free, and where their fit starts."""

    of: type[RigEffect]
    joint: str
    start: tuple[tuple[str, float], ...]

    @property
    def place(self) -> tuple[str, str | None]:
        """Name of the cause, and its joint."""
        return self.of.name, self.joint if self.of.of_joint else None

    def at(self, values: Sequence[float]) -> RigEffect:
        """Return the cause with these figures, as far as its bounds allow."""
        joint = {"joint": self.joint} if self.of.of_joint else {}
        return self.of.inside(**joint, **{name: float(x) for (name, _), x in zip(self.start, values)})


@dataclass(frozen=True, eq=False)
class Fitted:
    """Causes, fitted together to a difference.

    Attributes:
        forms: The causes.
        values: Their figures, one array each.
        response: The change in base parameters that they make, (b,).
        cost: What they leave, in units of the noise: s.
        freedom: How many directions of their figures show: k.
        covariance: Of all figures in order, if only noise is left; zero where nothing shows.
    """

    forms: tuple[Form, ...]
    values: tuple[Array, ...]
    response: Array
    cost: float
    freedom: int
    covariance: Array

    @property
    def spare(self) -> int:
        """Directions to which no figure was fitted: b - k."""
        return len(self.response) - self.freedom

    @property
    def dispersion(self) -> float:
        """φ, one where nothing is left to judge by."""
        return max(1.0, self.cost / max(self.spare, 1))

    @property
    def places(self) -> frozenset[tuple[str, str | None]]:
        """Names of the causes, and their joints."""
        return frozenset(form.place for form in self.forms)

    @property
    def causes(self) -> list[RigEffect]:
        """The causes with their figures."""
        return [form.at(x.tolist()) for form, x in zip(self.forms, self.values)]

    def std(self, form: Form) -> Array:
        """Standard deviations of a cause's figures, (p,), by what the fit leaves; nan where nothing shows."""
        at = self.forms.index(form)
        power = np.split(np.diag(self.covariance), np.cumsum([len(x) for x in self.values]))[at]
        return np.where(power > 0, np.sqrt(self.dispersion * np.maximum(power, 0.0)), np.nan)


@dataclass(frozen=True, eq=False)
class Bodies:
    """The search for causes of a difference.

    Attributes:
        found: The difference.
        causes: The causes to look for; those in the rig count.
    """

    found: Difference
    causes: Mapping[str, type[Cause]]
    fits: dict[frozenset[Form], Fitted | None] = field(default_factory=dict)

    @cached_property
    def forms(self) -> tuple[Form, ...]:
        """Forms of all causes that show in the base parameters, and of which these can say all that they do."""
        rig = self.found.rig
        every = [kind for kind in self.causes.values() if issubclass(kind, RigEffect)]
        places = [(kind, joint) for kind in every for joint in (rig.joints if kind.of_joint else rig.joints[:1])]
        forms = [Form(kind, joint, tuple(start.items())) for kind, joint in places for start in kind.forms(rig)]
        return tuple(form for form in forms if self.tells(form))

    @cached_property
    def many(self) -> int:
        """How many causes there are to choose from: K."""
        return len({form.place for form in self.forms})

    @property
    def limit(self) -> float:
        """Log of the chance from which a cause is none: one of K gains so much by luck with a chance of α."""
        return float(np.log(ERROR_RATE / max(self.many, 1)))

    @cached_property
    def motion(self) -> tuple[Array, Array, Array]:
        """Poses that show all, with speeds and accelerations."""
        return spread_states(self.found.rig)

    @cached_property
    def torques(self) -> tuple[Array, Array, Array]:
        """Base columns over these, (m, b), their pseudo-inverse, and the given rig's torque, (m,)."""
        rig, places = self.found.rig, find_base_columns(self.found.rig, self.found.reduction)
        columns = compute_regressor(rig, *self.motion)[:, :, places].reshape(-1, len(places))
        return columns, np.linalg.pinv(columns), compute_rnea(rig, *self.motion).ravel()

    def torque(self, causes: Sequence[RigEffect]) -> Array:
        """Torque that causes add to the given rig's, (m,); nan where no body allows them."""
        try:
            return compute_rnea(altered(self.found.rig, causes), *self.motion).ravel() - self.torques[2]
        except UsageError:
            return np.full(len(self.torques[2]), np.nan)

    def response(self, causes: Sequence[RigEffect]) -> Array:
        """Change of the base parameters that gives the given rig the torques it has with causes, (b,)."""
        return self.torques[1] @ self.torque(causes)

    def tells(self, form: Form) -> bool:
        """Whether the base parameters show any figure of a form, and make up for all torque that it adds."""
        values = np.array([value for _, value in form.start])
        torque = self.torque([form.at((values + STEP).tolist())])
        missed = torque - self.torques[0] @ (self.torques[1] @ torque)
        if not np.linalg.norm(missed) <= RANK * np.linalg.norm(torque):
            return False
        return self.shown((form,), self.slopes((form,), values))[1] > 0

    def made(self, forms: Sequence[Form], x: Array) -> Array:
        """Response to forms with all their figures in a row."""
        return self.response([form.at(own.tolist()) for form, own in zip(forms, parted(forms, x))])

    def slopes(self, forms: Sequence[Form], x: Array) -> Array:
        """Base parameters per figure, (b, p), by differences to where a body allows a step; none where it does not."""
        here, columns = self.made(forms, x), []
        for step in STEP * np.eye(len(x)):
            ahead = self.made(forms, x + step)
            columns.append(ahead - here if np.isfinite(ahead).all() else here - self.made(forms, x - step))
        return np.nan_to_num(np.stack(columns, axis=1) / STEP)

    def shown(self, forms: Sequence[Form], slopes: Array) -> tuple[Array, int]:
        """Pseudo-inverse of slopes over the directions that show, (p, b), and how many these are.

        A direction shows that noise does not hide all the way between the figures' bounds.
        """
        bounds = limits(forms)
        left, size, right = np.linalg.svd(self.found.whitener @ slopes * (bounds[1] - bounds[0]), full_matrices=False)
        shown = size > max(1.0, RANK * float(size.max(initial=0.0)))
        gain = (right[shown].T / size[shown]) @ left[:, shown].T @ self.found.whitener
        return (bounds[1] - bounds[0])[:, None] * gain, int(shown.sum())

    @cached_property
    def nothing(self) -> Fitted:
        """The fit of no cause at all."""
        change = self.found.change
        return Fitted((), (), np.zeros(len(change)), self.cost(change), 0, np.zeros((0, 0)))

    def cost(self, left: Array) -> float:
        """Sum of squares of a change in units of the noise."""
        return float(np.sum((self.found.whitener @ left) ** 2))

    def fitted(self, forms: Sequence[Form], near: Fitted | None = None) -> Fitted | None:
        """Fit causes together by least squares, from the figures that a fit `near` has; None where no body allows."""
        if not forms:
            return self.nothing
        if (key := frozenset(forms)) not in self.fits:
            known = {} if near is None else dict(zip(near.forms, near.values))
            starts = [known.get(form, np.array([value for _, value in form.start])) for form in forms]
            self.fits[key] = self.solved(tuple(forms), np.concatenate(starts))
        return self.fits[key]

    def solved(self, forms: tuple[Form, ...], x: Array) -> Fitted | None:
        """Compute what `fitted` returns, first beside sizes that a form starts from; no step goes where no body may."""
        from scipy.optimize import least_squares

        W, change, bounds = self.found.whitener, self.found.change, limits(forms)
        if not np.isfinite(self.made(forms, x)).all():
            return None
        free = np.array([not value for form in forms for _, value in form.start])
        for which in (free, np.ones_like(free))[int(free.all()) :]:
            x = least_squares(
                lambda at: W @ (self.made(forms, at) - change),
                x,
                lambda at, which=which: W @ self.slopes(forms, at) * which,
                bounds,
                x_scale=(bounds[1] - bounds[0]) / 2,
                ftol=CLOSE,
                max_nfev=PASSES,
            ).x
        values = parted(forms, x)
        if not all(form.at(own.tolist()).plausible(self.found.rig) for form, own in zip(forms, values)):
            return None
        response = self.made(forms, x)
        gain, freedom = self.shown(forms, self.slopes(forms, x))
        covariance = gain @ self.found.covariance @ gain.T
        return Fitted(forms, tuple(values), response, self.cost(change - response), freedom, covariance)

    def beside(self, fit: Fitted, instead: Form | None = None) -> Iterator[Fitted]:
        """Yield fits with another cause beside those of a fit, or in the place of one of them."""
        rest = tuple(form for form in fit.forms if form is not instead)
        taken = {one.place for one in rest}
        for form in self.forms:
            if form.place not in taken and form is not instead and (new := self.fitted((*rest, form), fit)):
                yield new

    def without(self, fit: Fitted, form: Form) -> Fitted:
        """Return the fit of all but one cause; of nothing, where no rig could be so."""
        return self.fitted([one for one in fit.forms if one is not form], fit) or self.nothing

    def selected(self) -> Fitted:
        """Return as few causes as explain the difference; none, where too much of it is left.

        Grown with a beam as far as any could be worth it, as what hides each other shows only together; then mended.
        """
        seen, value = set[frozenset[Form]](), partial(worth, self.nothing)
        front = [fit := self.nothing]
        while front := [one for one in front if self.open(one) and value(ideal(one)) < value(fit)]:
            grown = sorted((more for one in front for more in self.beside(one)), key=value)
            front = sorted({one.places: one for one in reversed(grown)}.values(), key=value)[:BEAM]
            fit = min([fit, *front], key=value)
        while (other := self.mended(fit)) and (key := frozenset(other.forms)) not in seen:
            seen.add(key)
            fit = other
        noise, whole = len(self.found.change), self.nothing.cost
        return self.nothing if fit.cost - noise > UNEXPLAINED * max(whole - noise, 0.0) else fit

    def open(self, fit: Fitted) -> bool:
        """Whether one more figure could be worth it."""
        return len(fit.forms) < MOST and chance(fit, ideal(fit)) < self.limit

    def mended(self, fit: Fitted) -> Fitted | None:
        """Return the fit without a needless cause, with a better one in its place, or with one more; None: as it is."""
        lesser = {form: self.without(fit, form) for form in fit.forms}
        needless = [less for less in lesser.values() if chance(less, fit) >= self.limit]
        if needless:
            return min(needless, key=lambda less: less.cost)
        for form, less in lesser.items():
            other = min(self.beside(fit, form), key=partial(worth, less), default=fit)
            if worth(less, other) < worth(less, fit):
                return other
        more = min(self.beside(fit), key=partial(worth, fit), default=fit) if self.open(fit) else fit
        return more if chance(fit, more) < self.limit else None


def ideal(fit: Fitted) -> Fitted:
    """Return what no fit with more causes can do better: one figure more, and noise is left."""
    return replace(fit, cost=fit.spare - 1.0, freedom=fit.freedom + 1)


def chance(less: Fitted, more: Fitted) -> float:
    """Log of the chance that what some causes leave falls as far with further ones, if that is no more than an error.

    ``F = (s - s')/(k' - k)/φ'`` with k' - k and b - k' degrees of freedom: such an error points anywhere.
    """
    many = max(more.freedom - less.freedom, 1)
    gain = (less.cost - more.cost) / many / more.dispersion
    return float(f.logsf(gain, many, more.spare)) if more.spare > 0 else 0.0


def worth(less: Fitted, more: Fitted) -> tuple[float, int]:
    """Return what to choose the least of: the chance, and of what is as good, the simplest."""
    return round(chance(less, more), 1), sum(len(x) for x in more.values)


def altered(rig: Rig, causes: Sequence[RigEffect]) -> Rig:
    """Return the rig with causes in it; `UsageError` where no body allows them."""
    for cause in causes:
        rig = cause.apply(rig)
    return rig


def parted(forms: Sequence[Form], x: Array) -> list[Array]:
    """Figures of each form, from all in a row."""
    return np.split(x, np.cumsum([len(form.start) for form in forms])[:-1])


def limits(forms: Sequence[Form]) -> tuple[Array, Array]:
    """Lower and upper bounds of all figures in a row, (p,) each."""
    shapes = [{shape.name: shape for shape in form.of.shapes}[name] for form in forms for name, _ in form.start]
    return np.array([shape.lower for shape in shapes]), np.array([shape.upper for shape in shapes])
