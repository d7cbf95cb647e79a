"""Which causes in a rig make up what sets the refitted base parameters apart from the given ones, and how large.

``δ = r(x) + e`` over b base parameters, in which the causes' figures x use k directions up; ``s = |W e|²`` in units of
the noise. What no cause explains is an error of form, as large in one direction as in another (quasi-likelihood:
McCullagh and Nelder 1989, section 4.5): ``φ = max(1, s/(b - k))``. A cause is one where it lowers s by more than a part
of such an error would: an F test, at the rate α/K of K causes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import f

from gimbal_pin.dynamics.reduction import spread_states
from gimbal_pin.dynamics.regressor import compute_regressor, compute_rnea
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import BaseDifference
from gimbal_pin.identification.difference import LEAST_KEPT
from gimbal_pin.identification.payload import DEVIATIONS
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Flags, find_base_columns
from gimbal_pin.rig.rig import Rig

_ERROR_RATE = 0.01
"""Chance α of a cause where there is none."""
_BEAM, _LARGEST_SET = 3, 6
"""Sets of each size that are extended, and causes in the largest."""
_STEP = 1e-6
"""Step of differences, kg, m, rad or kg m²: too small for a body to forbid, and round-off leaves eight digits."""
_UNEXPLAINED = 0.2
"""Share of the difference's power that may be left, or no name deserves trust."""

Place = tuple[str, str | None]
"""Name of a cause, and its joint."""


class Form(NamedTuple):
    """A cause without its figures: its class, its joint, the figures that are free, and where their fit starts."""

    kind: type[RigEffect]
    joint: str
    start: tuple[tuple[str, float], ...]

    @property
    def place(self) -> Place:
        """Name of the cause, and its joint."""
        return self.kind.name, self.joint if self.kind.of_joint else None

    @property
    def initial(self) -> Array:
        """Figures where the fit starts, (p,)."""
        return np.array([value for _, value in self.start])

    def build(self, values: Array) -> RigEffect:
        """Return the cause with these figures, as far as its bounds allow."""
        joint = {"joint": self.joint} if self.kind.of_joint else {}
        return self.kind.inside(
            **joint, **{name: float(x) for (name, _), x in zip(self.start, values.tolist())}
        )


class FittedForms(NamedTuple):
    """Causes, fitted together to a difference.

    Attributes:
        values: Their figures.
        response: The change in base parameters that they make, (b,).
        cost: What they leave, in units of the noise: s.
        freedom: How many directions of their figures show: k.
        std: Standard deviations of the figures by what the fit leaves; nan where nothing shows.
    """

    values: dict[Form, Array]
    response: Array
    cost: float
    freedom: int
    std: dict[Form, Array]

    @property
    def spare(self) -> int:
        """Directions to which no figure was fitted: b - k."""
        return len(self.response) - self.freedom

    @property
    def dispersion(self) -> float:
        """φ, one where nothing is left to judge by."""
        return max(1.0, self.cost / max(self.spare, 1))

    @property
    def causes(self) -> dict[Form, RigEffect]:
        """The causes with their figures."""
        return {form: form.build(x) for form, x in self.values.items()}

    def is_known(self, form: Form) -> Flags:
        """Which figures of a cause are known to two deviations, (p,)."""
        return np.asarray(np.abs(self.values[form]) > DEVIATIONS * self.std[form])

    def compute_odds(self, other: FittedForms) -> float:
        """``(s' - s)/2φ + (k' - k)/2 log b``: logarithm of the odds of these causes over others (Schwarz 1978)."""
        schwarz = (other.freedom - self.freedom) * np.log(len(self.response)) / 2
        return float((other.cost - self.cost) / (2 * self.dispersion) + schwarz)


class GivenCauses(NamedTuple):
    """Causes of a difference.

    Attributes:
        best: They, fitted together.
        false_alarms: Probability of as much of each where there is none, at any of the places that were looked at.
        rivals: With each other cause in a form's place, the fit.
    """

    best: FittedForms
    false_alarms: dict[Form, float]
    rivals: dict[Form, list[FittedForms]]


def find_given_causes(difference: BaseDifference, causes: Mapping[str, type[Cause]]) -> GivenCauses:
    """Find as few causes as explain a difference, of those that are in the rig; none, where too much of it is left."""
    search = _Search(difference, causes)
    best = search.select()
    less = {form: search.drop(best, form) for form in best.values}
    return GivenCauses(
        best,
        {
            form: float(np.exp(min(0.0, _compute_chance(one, best) + search.tries)))
            for form, one in less.items()
        },
        {form: list(search.extend(best, form)) for form in best.values},
    )


def change_rig(rig: Rig, causes: Sequence[RigEffect]) -> Rig:
    """Return the rig with causes in it.

    Raises:
        UsageError: No body allows them.
    """
    for cause in causes:
        rig = cause.apply(rig)
    return rig


class GivenResponse:
    """Base parameters that causes make of the given rig's."""

    def __init__(self, difference: BaseDifference) -> None:
        self.difference = difference
        self._motion = spread_states(difference.rig)
        places = find_base_columns(difference.rig, difference.reduction)
        self._columns = compute_regressor(difference.rig, *self._motion)[:, :, places].reshape(
            -1, len(places)
        )
        self._inverse = np.linalg.pinv(self._columns)
        self._torque = compute_rnea(difference.rig, *self._motion).ravel()

    def compute_torque(self, causes: Sequence[RigEffect]) -> Array:
        """Torque that causes add in poses that show all, (m,); nan where no body allows them."""
        try:
            return (
                compute_rnea(change_rig(self.difference.rig, causes), *self._motion).ravel()
                - self._torque
            )
        except UsageError:
            return np.full(len(self._torque), np.nan)

    def compute(self, causes: Sequence[RigEffect]) -> Array:
        """Change of the base parameters that gives the given rig the torques it has with causes, (b,)."""
        return self._inverse @ self.compute_torque(causes)

    def is_exact(self, cause: RigEffect) -> bool:
        """Whether the base parameters make up for all torque that a cause adds."""
        torque = self.compute_torque([cause])
        missed = torque - self._columns @ (self._inverse @ torque)
        return bool(np.linalg.norm(missed) <= LEAST_KEPT * np.linalg.norm(torque))


class _Search:
    """The search of `find_given_causes`; every set of forms is fitted once."""

    def __init__(self, difference: BaseDifference, causes: Mapping[str, type[Cause]]) -> None:
        rig = difference.rig
        self.difference = difference
        self.response = GivenResponse(difference)
        cost = self.compute_cost(difference.change)
        self.nothing = FittedForms({}, np.zeros_like(difference.change), cost, 0, {})
        self.fits: dict[frozenset[Form], FittedForms | None] = {frozenset(): self.nothing}
        every = [kind for kind in causes.values() if issubclass(kind, RigEffect)]
        places = [
            (kind, joint)
            for kind in every
            for joint in (rig.joints if kind.of_joint else rig.joints[:1])
        ]
        forms = [
            Form(kind, joint, tuple(start.items()))
            for kind, joint in places
            for start in kind.forms(rig)
        ]
        self.forms = [form for form in forms if self.is_shown(form)]
        self.tries = float(np.log(max(len({form.place for form in self.forms}), 1)))

    def is_shown(self, form: Form) -> bool:
        """Whether the base parameters show any figure of a form, and make up for all torque that it adds."""
        if not self.response.is_exact(form.build(form.initial + _STEP)):
            return False
        return self.invert((form,), self.compute_slopes((form,), form.initial))[1] > 0

    def compute_response(self, forms: Sequence[Form], x: Array) -> Array:
        """Response to forms with all their figures in a row."""
        return self.response.compute(
            [form.build(own) for form, own in zip(forms, _split(forms, x))]
        )

    def compute_slopes(self, forms: Sequence[Form], x: Array) -> Array:
        """Base parameters per figure, (b, p), by differences; none where no body allows the step."""
        here = self.compute_response(forms, x)
        ahead = [self.compute_response(forms, x + step) for step in _STEP * np.eye(len(x))]
        return np.nan_to_num((np.stack(ahead, axis=1) - here[:, None]) / _STEP)

    def invert(self, forms: Sequence[Form], slopes: Array) -> tuple[Array, int]:
        """Pseudo-inverse of slopes over the directions that show, (p, b), and how many these are.

        A direction shows that noise does not hide all the way between the figures' bounds.
        """
        low, high = _get_bounds(forms)
        W = self.difference.whitener
        left, size, right = np.linalg.svd(W @ slopes * (high - low), full_matrices=False)
        shown = size > max(1.0, LEAST_KEPT * float(size.max(initial=0.0)))
        return (high - low)[:, None] * ((right[shown].T / size[shown]) @ left[:, shown].T @ W), int(
            shown.sum()
        )

    def compute_cost(self, left: Array) -> float:
        """Sum of squares of a change in units of the noise."""
        return float(np.sum((self.difference.whitener @ left) ** 2))

    def fit(self, forms: Sequence[Form], near: FittedForms) -> FittedForms | None:
        """Fit causes together by least squares, from the figures of a fit; None where no body or rig allows them."""
        if (key := frozenset(forms)) not in self.fits:
            start = np.concatenate([near.values.get(form, form.initial) for form in forms])
            self.fits[key] = self.minimise(forms, start)
        return self.fits[key]

    def minimise(self, forms: Sequence[Form], x: Array) -> FittedForms | None:
        """Fit causes by least squares; no step goes where no body may."""
        from scipy.optimize import least_squares

        change = self.difference.change
        W = self.difference.whitener
        if not np.isfinite(self.compute_response(forms, x)).all():
            return None
        low, high = _get_bounds(forms)
        x = least_squares(
            lambda at: W @ (self.compute_response(forms, at) - change),
            x,
            lambda at: W @ self.compute_slopes(forms, at),
            (low, high),
            x_scale=(high - low) / 2,
            ftol=1e-4,
            max_nfev=30,  # what goes on beyond that fits badly
        ).x
        values = dict(zip(forms, _split(forms, x)))
        if not all(form.build(own).plausible(self.difference.rig) for form, own in values.items()):
            return None
        response = self.compute_response(forms, x)
        gain, freedom = self.invert(forms, self.compute_slopes(forms, x))
        fit = FittedForms(values, response, self.compute_cost(change - response), freedom, {})
        power = np.diag(gain @ self.difference.covariance @ gain.T) * fit.dispersion
        return fit._replace(
            std=dict(zip(forms, _split(forms, np.sqrt(np.where(power > 0, power, np.nan)))))
        )

    def extend(self, fit: FittedForms, instead: Form | None = None) -> Iterator[FittedForms]:
        """Yield fits with another cause beside those of a fit, or in the place of one of them."""
        rest = [form for form in fit.values if form is not instead]
        taken = {one.place for one in rest}
        for form in self.forms:
            if (
                form.place not in taken
                and form is not instead
                and (new := self.fit([*rest, form], fit))
            ):
                yield new

    def drop(self, fit: FittedForms, form: Form) -> FittedForms:
        """Return the fit of all but one cause; of nothing, where no rig could be so."""
        return self.fit([one for one in fit.values if one is not form], fit) or self.nothing

    def select(self) -> FittedForms:
        """Return as few causes as explain the difference; none, where too much of it is left.

        Grown with a beam, as what hides each other shows only together, as far as any set could be worth it: no fit
        does better than to leave noise with one figure more. Then what is needless goes.
        """
        worth = partial(_compute_worth, self.nothing)
        best = self.nothing
        front = [best]
        for _ in range(_LARGEST_SET):
            ideal = [one._replace(cost=one.spare - 1.0, freedom=one.freedom + 1) for one in front]
            front = [
                one
                for one, more in zip(front, ideal)
                if self.is_gain(one, more) and worth(more) < worth(best)
            ]
            grown = sorted((more for one in front for more in self.extend(one)), key=worth)
            alike = {frozenset(form.place for form in one.values): one for one in reversed(grown)}
            front = sorted(alike.values(), key=worth)[:_BEAM]
            best = min([best, *front], key=worth)
        while needless := [
            one for form in best.values if not self.is_gain(one := self.drop(best, form), best)
        ]:
            best = min(needless, key=lambda one: one.cost)
        noise = len(self.difference.change)
        whole = self.nothing.cost
        return self.nothing if best.cost - noise > _UNEXPLAINED * max(whole - noise, 0.0) else best

    def is_gain(self, less: FittedForms, more: FittedForms) -> bool:
        """Whether luck gains so much with a chance of less than α, trying all causes."""
        return _compute_chance(less, more) < np.log(_ERROR_RATE) - self.tries


def _compute_chance(less: FittedForms, more: FittedForms) -> float:
    """Log of the chance that what some causes leave falls as far with further ones, if that is no more than an error.

    ``F = (s - s')/(k' - k)/φ'`` with k' - k and b - k' degrees of freedom: such an error points anywhere.
    """
    many = max(more.freedom - less.freedom, 1)
    gain = (less.cost - more.cost) / many / more.dispersion
    return float(f.logsf(gain, many, more.spare)) if more.spare > 0 else 0.0


def _compute_worth(less: FittedForms, more: FittedForms) -> tuple[float, int]:
    """Return what to choose the least of: the chance, and of what is as good, the simplest."""
    return round(_compute_chance(less, more), 1), sum(len(x) for x in more.values.values())


def _split(forms: Sequence[Form], x: Array) -> list[Array]:
    """Figures of each form, from all in a row."""
    return np.split(x, np.cumsum([len(form.start) for form in forms])[:-1])


def _get_bounds(forms: Sequence[Form]) -> tuple[Array, Array]:
    """Lower and upper bounds of all figures in a row, (p,) each."""
    shapes = [
        {shape.name: shape for shape in form.kind.shapes}[name]
        for form in forms
        for name, _ in form.start
    ]
    return np.array([shape.lower for shape in shapes]), np.array([shape.upper for shape in shapes])
