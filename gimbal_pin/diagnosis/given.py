"""The given model against the refitted one: base parameters with a robust covariance, read as the payload's place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from gimbal_pin.diagnosis.engine.criterion import FORM
from gimbal_pin.diagnosis.state import State
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import compute_inertia_regressor
from gimbal_pin.effects.rig_effect import (
    DIRECTIONS,
    compute_gyration_radius,
    find_camera_axes,
    find_joint_axis,
    find_payload_link,
    get_payload,
    shift_inertia,
)
from gimbal_pin.errors import UsageError, digits
from gimbal_pin.identification import Identified, given_beta
from gimbal_pin.identification.balance import report_with_balance as weighed
from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    build_discrepancy_columns,
    find_base_columns,
    fit_misfit,
    map_phi_to_base,
    propagate_misfit,
)
from gimbal_pin.regression.consistency import compute_deformation_root
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

RANK = 1e-6
"""A direction that keeps less than this of the largest, once the others are projected out, is not shown by the rig."""
SHOWN = 0.1
"""Standard deviation from which a log does not show a difference, as a share of what the payload has: of its mass, of
its radius of gyration, of its body's largest moment of inertia: what is known no better is not worth a figure."""
SURE = 0.003
"""Chance of speaking of a difference where there is none: three deviations."""
TOLD = 2.0
"""Standard deviations from which a direction is spoken of, 95 %."""
IMPOSSIBLE = "the fit's figure is no body's, which points at noise in the motion or at torque that the model lacks"
"""What is said in place of a mass or an inertia that no body can have."""
TRIAL, FAINT = 0.03, 0.05
"""Share of a mass, and the millimetres from which it is said what that much more of it does."""
SHARES, HALVINGS = (1e-4, 1.0), 12
"""Between which shares other bodies' difference from the URDF is looked for, and in how many halvings."""
MOMENTS, INERTIA, PRODUCTS = [1, 2, 3], [4, 5, 6, 7, 8, 9], [5, 7, 8]
"""Places in a body's ten parameters, in the order of `rig.PHI`."""


class Seen(NamedTuple):
    """What of some parameters a difference shows.

    Attributes:
        basis: Directions in the parameters' space that are shown, orthonormal, (p, r).
        value: The change along each, (r,).
        covariance: Of these, (r, r).
    """

    basis: Array
    value: Array
    covariance: Array

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @property
    def change(self) -> Array:
        """The parameters' change, nothing along what is not shown, (p,)."""
        return self.basis @ self.value

    @property
    def std(self) -> Array:
        """Its standard deviations, (p,)."""
        return np.sqrt(np.maximum(np.diag(self.basis @ self.covariance @ self.basis.T), 0.0))

    @property
    def axes(self) -> list[bool]:
        """Whether each of the p axes lies more than half in the directions that are shown."""
        return [bool(np.linalg.norm(row) > 0.5) for row in self.basis]

    def turned(self, axes: Array) -> Seen:
        """Return it along other axes, columns (p, p)."""
        return self._replace(basis=axes.T @ self.basis)

    @property
    def hidden(self) -> Seen:
        """The same parameters, with nothing of them shown."""
        return Seen(self.basis[:, :0], self.value[:0], self.covariance[:0, :0])

    @property
    def chance(self) -> float:
        """Chance of as large a change where there is none."""
        if not len(self.value):
            return 1.0
        return float(chi2.sf(self.value @ np.linalg.solve(self.covariance, self.value), len(self.value)))


@dataclass(frozen=True, eq=False)
class Difference:
    """``change = beta refitted - beta given``.

    Attributes:
        rig: The given rig.
        reduction: Its base parameters.
        change: In SI units, (b,).
        covariance: Of the change under the residual's own colour, (b, b).
        weighting: Of the change if the residual were white, (b, b): what the least squares are weighted by, since a
            covariance estimated from few blocks of time has no inverse that deserves trust.
    """

    rig: Rig
    reduction: Reduction
    change: Array
    covariance: Array
    weighting: Array

    @staticmethod
    def of_state(state: State) -> Difference:
        """``cov = H⁻¹ (Σ_blocks g gᵀ) H⁻¹ + Σ_joints R Rᵀ``, R what the fit misses there: see `misfit.moved`."""
        rig, reduction, fit = state.problem.evidence.rig, state.problem.reduction, state.fit
        width = len(reduction.independent)
        scores = fit.by_block(fit.stack * fit.residual[:, None])
        blocks = len(scores)
        spread = fit.information @ (scores.T @ scores) @ fit.information * blocks / max(blocks - 1, 1)
        change = fit.theta[:width] - given_beta(rig, reduction)
        found = Difference(rig, reduction, change, spread[:width, :width], fit.information[:width, :width])
        return found.widened(np.hstack([missed(state, j)[:width] for j in range(rig.n)]))

    @staticmethod
    def of_identified(rig: Rig, found: Identified) -> Difference:
        """Return the difference of what `identify` estimated from what the rig states."""
        width = len(found.reduction.independent)
        spread = found.estimate.covariance[:width, :width]
        change = found.estimate.theta[:width] - given_beta(rig, found.reduction)
        return Difference(rig, found.reduction, change, spread, spread)

    @cached_property
    def responses(self) -> Array:
        """Change of the base parameters per change of each entry of `Rig.phi`, (b, 10 n)."""
        return map_phi_to_base(self.rig, self.reduction)

    @cached_property
    def whitener(self) -> Array:
        """``W = L⁻¹/√c``, ``weighting = L Lᵀ``, (b, b): noise of unit variance on average, ``tr(W cov Wᵀ) = b``."""
        std = np.sqrt(np.diag(self.weighting))
        correlation = self.weighting / np.outer(std, std) + 1e-12 * np.eye(len(std))
        white = np.linalg.inv(np.linalg.cholesky(correlation)) / std
        return np.asarray(white / np.sqrt(np.trace(white @ self.covariance @ white.T) / len(std)))

    def seen(self, wanted: Array, unknown: Array, limit: float) -> Seen:
        """Least squares for the wanted parameters, whatever the unknown ones are.

        Args:
            wanted: Base parameters per wanted parameter, (b, p).
            unknown: The same of what is to be left open, (b, m).
            limit: Standard deviation, in the wanted parameters' unit, from which a direction is not shown.
        """
        W = self.whitener
        columns = outside(W @ unknown, W @ wanted)
        left, size, right = np.linalg.svd(columns, full_matrices=False)
        floor = RANK * max(float(np.linalg.norm(W @ wanted)), 1e-300)
        shown = (size > floor) & (size * limit > 1.0)
        gain = (left[:, shown] / size[shown]).T @ W
        return Seen(right[shown].T, gain @ self.change, gain @ self.covariance @ gain.T)

    def left(self, columns: Array) -> tuple[float, int]:
        """Power of the change outside the reach of some columns, (b, m), in units of noise, and in how many ways."""
        rest = outside(self.whitener @ columns, (self.whitener @ self.change)[:, None])
        return float(np.sum(rest**2)), len(self.change) - int(np.linalg.matrix_rank(self.whitener @ columns, tol=None))

    def lack_of_fit(self, columns: Array) -> float:
        """Chance of as much change outside the reach of some columns, (b, m), where there is none."""
        power, freedom = self.left(columns)
        return float(chi2.sf(power, freedom)) if freedom else 1.0

    def widened(self, root: Array) -> Difference:
        """Return it with a root of another covariance, (b, r), in its own."""
        W, more = self.whitener, root @ root.T
        noise = self.weighting * len(self.change) / np.trace(W @ self.weighting @ W.T)
        return replace(self, covariance=self.covariance + more, weighting=noise + more)


def possible(inertia: float, mass: float = 1.0, moment: float = 0.0) -> bool:
    """``m > 0``, ``I > h²/m``: whether a mass with the first moment h about an axis can have this inertia about it."""
    return mass > 0 and inertia > moment**2 / mass


def missed(state: State, joint: int) -> Array:
    """Return by how much what a fit misses at a joint may move its coefficients, (k, f): see `misfit.moved`."""
    evidence, fit, rows = state.problem.evidence, state.fit, state.fit.rows(joint)
    parts = [part.channels for part in evidence.parts]
    q, v = (np.concatenate([getattr(part, name)[:, joint] for part in parts]) for name in "qv")
    ends = np.cumsum([len(part.q) for part in parts])[:-1]
    X, A = evidence.whiten(np.split(build_discrepancy_columns(q, v), ends), joint), fit.stack[rows]
    X /= max(float(np.sqrt(np.mean(X**2))), 1e-300)  # `misfit` knows columns of about unit size, which cosines are
    one = fit_misfit(A[:, A.any(axis=0)], X, fit.target[rows], float(evidence.used()[joint]) * len(X))
    return propagate_misfit(fit.information, A, X, one)


def outside(span: Array, columns: Array) -> Array:
    """Take out of columns (b, p) what lies in the span of others (b, m), which may depend on each other."""
    if not span.shape[1]:
        return columns
    size = np.linalg.norm(span, axis=0)
    unit = span[:, size > 0] / size[size > 0]
    left, values, _ = np.linalg.svd(unit, full_matrices=False)
    basis = left[:, values > 1e-9 * values.max(initial=0.0)]
    once = columns - basis @ (basis.T @ columns)
    return np.asarray(once - basis @ (basis.T @ once))


@dataclass(frozen=True, eq=False)
class Given:
    """What sets the payload apart from its URDF.

    Attributes:
        link: The payload's link, in whose frame the shift stands.
        body: The moving link that carries it, in whose joint's frame the products of inertia stand.
        alone: Whether the payload's parameters explain all of the difference; else the other bodies are left open, and
            only what shows without them is said.
        stated: The mass that its URDF states, kg.
        mass: Difference from it, kg, one value, or none where it does not show.
        shift: Of the centre of mass of the payload with the mass above, m, forms (3,) with its directions.
        per_mass: Change of that shift if the payload has a kilogram more, m/kg, (3,): a body that carries it off the
            joints' axes pulls as one that sits further out, and what sits off its place does so less if it is heavier.
        products: Difference of Ixy, Ixz and Iyz of the whole body, beyond what shift and mass make of them, kg m².
        words: Forward, left and up as the camera sees them, as columns in the payload's frame, (3, 3).
        gyration: The payload's radius of gyration as stated, m.
        moment: The body's largest moment of inertia as stated, kg m².
        possible: Whether a body can be so; if not, nothing of it is shown.
    """

    link: str
    body: str
    alone: bool
    stated: float
    mass: Seen
    shift: Seen
    per_mass: Array
    products: Seen
    words: Array
    gyration: float
    moment: float
    possible: bool

    __repr__ = brief

    @property
    def sentence(self) -> str:
        """Where the payload is, and what it weighs."""
        parts = [self.place(), self.weight()]
        if not self.alone:
            parts.append("other bodies of the rig differ from the URDF, too")
        if not self.possible:
            parts.append(IMPOSSIBLE)
        return "; ".join(parts)

    @property
    def lines(self) -> tuple[str, ...]:
        """All that is to be said."""
        return tuple(line for line in (self.sentence, self.skew()) if line)

    def place(self) -> str:
        """Say where it sits, in the camera's own directions."""
        shift, least = self.shift.turned(self.words), FORM * self.gyration
        change, std = shift.change, shift.std
        hidden = [f"{a}/{b}" for (a, b), shown in zip(DIRECTIONS, shift.axes) if not shown]
        unseen = f" ({' and '.join(hidden)} does not show)" if hidden else ""
        if len(hidden) == 3:
            return "the log does not show where the payload sits"
        told = np.where(np.abs(change) > np.maximum(TOLD * std, least), change, 0.0)
        if shift.chance > SURE or not told.any():
            most = max(float((np.abs(change) + TOLD * std).max()), least)
            return f"the payload sits where its URDF says, to {digits(1e3 * most, 2)} mm{unseen}"
        away = [
            f"{digits(1e3 * abs(x))} ± {digits(max(1e3 * s, 0.01), 1)} mm further {names[x < 0]}"
            for x, s, names in zip(told.tolist(), std.tolist(), DIRECTIONS)
            if x
        ]
        return f"the payload sits {', '.join(away)} than its URDF says{unseen}"

    def weight(self) -> str:
        """Say what it weighs."""
        if not len(self.mass.value):
            return f"its mass does not show: taken as the stated {digits(1e3 * self.stated, 4)} g{self.otherwise()}"
        extra, std = 1e3 * float(self.mass.change[0]), 1e3 * float(self.mass.std[0])
        if self.mass.chance > SURE:
            return f"it weighs the stated {digits(1e3 * self.stated, 4)} g, to {digits(TOLD * std, 2)} g"
        way = "heavier" if extra > 0 else "lighter"
        return f"it is {digits(abs(extra))} ± {digits(std, 2)} g {way} than the stated {digits(1e3 * self.stated, 4)} g"

    def otherwise(self) -> str:
        """Say how the place changes with a mass that the log does not show; nothing where it does not."""
        grams = 10.0 ** round(np.log10(TRIAL * 1e3 * self.stated))
        change = grams * self.words.T @ self.per_mass  # mm
        ways = [
            f"{digits(abs(x), 2)} mm {names[x < 0]}" for x, names in zip(change.tolist(), DIRECTIONS) if abs(x) > FAINT
        ]
        return f"; every {grams:g} g more would mean {', '.join(ways)} of that" if ways else ""

    def skew(self) -> str:
        """Say that the body's products of inertia are others than stated, or nothing."""
        size = float(np.abs(self.products.change).max(initial=0.0))
        if self.products.chance > SURE or size < FORM * self.moment:
            return ""
        shown = zip(("Ixy", "Ixz", "Iyz"), self.products.change.tolist(), self.products.std.tolist())
        figures = ", ".join(f"{name} by {x:+.2g} ± {digits(s, 1)}" for name, x, s in shown if abs(x) > TOLD * s)
        meaning = "turning one axis pushes the others more than the URDF says"
        return f"{self.body}: products of inertia differ from the URDF, {figures} kg m^2: {meaning}"

    def to_dict(self) -> dict[str, Any]:
        """Return `given_model` of `diagnose --json`: grams and millimetres, null where nothing is shown."""
        shown, com, std = self.shift.axes, 1e3 * self.shift.change, 1e3 * self.shift.std
        weighed = len(self.mass.value) > 0
        row = {
            "mass": 1e3 * float(self.mass.change[0]) if weighed else None,
            "com_mm": [float(x) if yes else None for x, yes in zip(com, shown)],
            "std": float(max(s for s, yes in zip(std, shown) if yes)) if any(shown) else None,
            "sentence": self.sentence,
            "com_mm_per_g": (self.per_mass).tolist(),
            "com_std_mm": [float(s) if yes else None for s, yes in zip(std, shown)],
            "mass_std": 1e3 * float(self.mass.std[0]) if weighed else None,
            "stated_mass": 1e3 * self.stated,
            "link": self.link,
            "alone": self.alone,
        }
        products = self.skewed()
        return {"camera": row, **({self.body: products} if products else {})}

    @property
    def weighs(self) -> tuple[float, float] | tuple[()]:
        """What the payload weighs, and the deviation of that, kg; nothing where it does not show."""
        return (self.stated + float(self.mass.change[0]), float(self.mass.std[0])) if len(self.mass.value) else ()

    def skewed(self) -> dict[str, Any]:
        """Return the products of inertia that are shown and differ, kg m², or nothing."""
        seen = self.products
        rows = zip(("Ixy", "Ixz", "Iyz"), seen.axes, seen.change.tolist(), seen.std.tolist())
        figures = {name: {"value": x, "std": s} for name, yes, x, s in rows if yes}
        return {**figures, "sentence": self.skew()} if self.skew() else {}


def compared(found: Identified) -> Given | None:
    """Compare what `identify` found with the rig that it was given; None where nothing is mounted that is known."""
    rig = found.model.rig.with_phi(found.given)
    return None if found.is_of_two_rigs or found.swapped else given(Difference.of_identified(rig, found))


def reported(found: Identified, apart: Given | None) -> dict[str, Any]:
    """Return what JSON holds of an identification, the payload's place and mass and the balance with it."""
    weighs = () if apart is None else apart.weighs
    return {**weighed(found, *weighs), "given_model": None if apart is None else apart.to_dict()}


def given(found: Difference) -> Given | None:
    """Explain a difference by the payload's ten parameters; None where the rig carries nothing with a mass.

    Inertias are left open: a shift is read from first moments, a mass from what it alone moves (arms that carry it off
    an axis). Where the payload cannot explain the difference, the other bodies differ from the URDF, too, by a share
    that is estimated, see `others`.
    """
    rig = found.rig
    try:
        body, inertia, frame = get_payload(rig)
    except UsageError:
        return None
    mine = slice(10 * body, 10 * body + 10)
    own = found.responses[:, mine]
    alone = found.lack_of_fit(own) > SURE
    found, open_ = (found, own[:, INERTIA]) if alone else others(found, body)
    moments = inertia.mass * own[:, MOMENTS] @ frame.rotation
    phi = inertia.toDynamicParameters()
    heavier = own @ (phi / inertia.mass)[:, None]
    moment = float(np.linalg.eigvalsh(rig.model.inertias[body + 1].inertia).max())
    radius = compute_gyration_radius(inertia)
    mass = found.seen(heavier, np.hstack([moments, open_]), SHOWN * inertia.mass)
    more, turned, fine = float(mass.change[0]), own[:, MOMENTS] @ frame.rotation, SHOWN * radius
    unsure = heavier[:, : len(mass.value)]
    first = found.seen(moments, np.hstack([unsure, open_]), fine)
    # About what was found: all of the payload's mass has moved, what it has more included.
    whole = inertia.mass + more
    moved = turned @ first.change * inertia.mass / whole
    beside = np.hstack([unsure + moved[:, None], open_])
    shift = replace(found, change=found.change + more * moved).seen(whole * turned, beside, fine)
    unweighed = -(heavier[:, 0] + moved) * (not len(mass.value))
    per_mass = replace(found, change=unweighed).seen(whole * turned, beside, fine).change

    def placed(extra: float) -> Array:
        """Change of the payload's ten parameters if it weighs so much more than was found, kg."""
        moved = shift_inertia(inertia, frame, shift.change + extra * per_mass).toDynamicParameters()
        return np.asarray(moved * (whole + extra) / inertia.mass - phi)

    left = replace(found, change=found.change - own @ placed(0.0))
    hidden = own @ (placed(TRIAL * inertia.mass) - placed(0.0))[:, None]  # an unknown mass makes products, too
    diagonal = np.delete(own, PRODUCTS, axis=1)
    products = left.seen(
        own[:, PRODUCTS], np.hstack([diagonal, open_[:, 6:], hidden[:, len(mass.value) :]]), SHOWN * moment
    )
    total = rig.phi[mine] + placed(0.0)
    about = compute_inertia_regressor(rig, np.zeros((1, rig.n)), body)[0, body, find_base_columns(rig, found.reduction)]
    off = float(np.linalg.norm(np.cross(find_joint_axis(rig, body), total[MOMENTS])))
    turns = float(about @ (given_beta(rig, found.reduction) + found.change))
    real = whole > 0 and possible(turns, float(total[0]), off)
    if not real:
        mass, shift, products, per_mass = mass.hidden, shift.hidden, products.hidden, np.zeros(3)
    return Given(
        link=find_payload_link(rig),
        body=rig.links[body],
        alone=alone,
        stated=float(inertia.mass),
        mass=mass,
        shift=shift,
        per_mass=per_mass,
        products=products,
        words=np.asarray(frame.rotation.T @ find_camera_axes(rig)),
        gyration=radius,
        moment=moment,
        possible=real,
    )


def others(found: Difference, body: int) -> tuple[Difference, Array]:
    """Return the difference, deviations holding what other bodies than one may differ by, and what is open beside it.

    Open are all inertias, as no URDF holds the motors' rotors; where that leaves nothing to judge by, the body's own.
    Masses and first moments are the URDF's, stretched by τ (`compute_deformation_root`), with τ so that what the body
    does not explain is as large as its degrees of freedom (Paule and Mandel, J. Res. Natl. Bur. Stand. 87, 1982).
    """
    mine = np.arange(10 * body, 10 * body + 10)
    own = found.responses[:, mine]
    order = sorted(range(found.rig.n), key=lambda k: k != body)
    open_ = found.responses[:, [10 * k + place for k in order for place in INERTIA]]
    if not found.left(np.hstack([own, open_]))[1]:
        open_ = own[:, INERTIA]
    apart = found.responses @ np.delete(compute_deformation_root(found.rig.phi), mine, axis=1)

    def allowed(share: float) -> Difference:
        return found.widened(share * apart)

    low, high = SHARES
    for _ in range(HALVINGS):
        share = float(np.sqrt(low * high))
        power, freedom = allowed(share).left(np.hstack([own, open_]))
        low, high = (share, high) if power > freedom else (low, share)
    return allowed(high), open_
