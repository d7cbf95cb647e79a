"""The payload of the given model against the refitted one: where it sits and what it weighs, from base parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.stats import chi2

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
from gimbal_pin.errors import NORMAL_95, UsageError, digits, finite_or_none, format_estimate
from gimbal_pin.identification.balance import Balance, KnownMass, compute_balance
from gimbal_pin.identification.difference import FALSE_ALARM, BaseDifference, ShownChange
from gimbal_pin.identification.identified import IdentificationResult
from gimbal_pin.log.log import Array
from gimbal_pin.regression import FORM_ERROR, TRUST, compute_deformation_root, find_base_columns
from gimbal_pin.rig.brief import brief

LEAST_KNOWN = 0.1
"""Standard deviation from which a log does not show a difference, as a share of what the payload has: of its mass, of
its radius of gyration, of its body's largest moment of inertia: what is known no better is not worth a figure."""
DEVIATIONS = 2.0
"""Standard deviations from which a direction is spoken of, 95 %."""
IMPOSSIBLE = "the fit's figure is no body's, which points at noise in the motion or at torque that the model lacks"
"""What is said in place of a mass or an inertia that no body can have."""
TRIAL_MASS, LEAST_SHIFT = 0.03, 0.05
"""Share of a mass, and the millimetres from which it is said what that much more of it does."""
MOMENT_PLACES = [1, 2, 3]
INERTIA_PLACES = [4, 5, 6, 7, 8, 9]
PRODUCT_PLACES = [5, 7, 8]
"""Places in a body's ten parameters, in the order of `rig.PHI`."""


def is_physical_inertia(inertia: float, mass: float = 1.0, moment: float = 0.0) -> bool:
    """``m > 0``, ``I > h²/m``: whether a mass with the first moment h about an axis can have this inertia about it."""
    return mass > 0 and inertia > moment**2 / mass


@dataclass(frozen=True, eq=False)
class PayloadDiscrepancy:
    """What sets the payload apart from its URDF.

    Attributes:
        link: The payload's link, in whose frame the shift stands.
        body: The moving link that carries it, in whose joint's frame the products of inertia stand.
        is_sufficient: Whether the payload's parameters explain all of the difference; else the other bodies are left
            open, and only what shows without them is said.
        stated: The mass that its URDF states, kg.
        is_weighed: Whether its mass was given beside the log: then that is no estimate.
        mass: Difference from the stated mass, kg, one value, or none where it does not show.
        shift: Of the centre of mass of the payload with the mass above, m, forms (3,) with its directions.
        per_mass: Change of that shift if the payload has a kilogram more, m/kg, (3,): a body that carries it off the
            joints' axes pulls as one that sits further out, and what sits off its place does so less if it is heavier.
        products: Difference of Ixy, Ixz and Iyz of the whole body, beyond what shift and mass make of them, kg m².
        camera: Forward, left and up as the camera sees them, as columns in the payload's frame, (3, 3).
        gyration: The payload's radius of gyration as stated, m.
        std_if_known: Deviation of the shift, m, if the bodies beside the payload were as the URDF says.
        moment: The body's largest moment of inertia as stated, kg m².
        is_physical: Whether a body can be so; if not, nothing of it is shown.
    """

    link: str
    body: str
    is_sufficient: bool
    stated: float
    is_weighed: bool
    mass: ShownChange
    shift: ShownChange
    per_mass: Array
    products: ShownChange
    camera: Array
    gyration: float
    std_if_known: float
    moment: float
    is_physical: bool

    __repr__ = brief

    @property
    def sentence(self) -> str:
        """Where the payload is, and what it weighs."""
        parts = [self._describe_place(), self._describe_mass()]
        if not self.is_sufficient:
            parts.append("other bodies of the rig differ from the URDF, too")
        if not self.is_physical:
            parts.append(IMPOSSIBLE)
        return "; ".join(parts)

    @property
    def lines(self) -> tuple[str, ...]:
        """All that is to be said."""
        return tuple(line for line in (self.sentence, self._describe_products()) if line)

    @property
    def found_mass(self) -> tuple[float, float] | tuple[()]:
        """What the payload weighs, and the deviation of that, kg; nothing where it does not show."""
        return (
            (self.stated + float(self.mass.change[0]), float(self.mass.std[0]))
            if len(self.mass.value)
            else ()
        )

    @property
    def known_mass(self) -> KnownMass | None:
        """The mass that its balance stands on; None where that is the stated one."""
        if not self.found_mass:
            return None
        return KnownMass(*self.found_mass, self.is_weighed, (self.mass.basis @ self.mass.gain)[0])

    def _describe_place(self) -> str:
        """Say where it sits, in the camera's own directions."""
        shift = self.shift._replace(basis=self.camera.T @ self.shift.basis)
        least = FORM_ERROR * self.gyration
        hidden = [f"{a}/{b}" for (a, b), shown in zip(DIRECTIONS, shift.axes) if not shown]
        closer = ""
        if np.isfinite(self.std_if_known) and (
            len(hidden) == 3 or shift.std.max() > DEVIATIONS * self.std_if_known
        ):
            sharp = digits(NORMAL_95 * max(1e3 * self.std_if_known, 0.01), 1)
            closer = f"; to ± {sharp} mm if the gimbal is known: --known, or 'inertia: trusted' where it was weighed"
        if len(hidden) == 3:
            return f"the log does not show where the payload sits{closer}"
        unseen = (f" ({' and '.join(hidden)} does not show)" if hidden else "") + closer
        way = _describe_direction(
            shift, least, "where its URDF says", "where that says", " than its URDF says"
        )
        return f"the payload sits {way}{unseen}"

    def _describe_mass(self) -> str:
        """Say what it weighs; of a mass that does not show, how the place changes with it."""
        stated = f"the stated {digits(1e3 * self.stated, 4)} g"
        if self.is_weighed and self.found_mass:
            return f"that is at the {digits(1e3 * self.found_mass[0], 4)} g that were weighed, of {stated}"
        if self.found_mass:
            extra = 1e3 * (self.found_mass[0] - self.stated)
            std = 1e3 * self.found_mass[1]
            if not self.mass.is_significant:
                return f"it weighs {stated}, to {digits(DEVIATIONS * std, 2)} g"
            way = "heavier" if extra > 0 else "lighter"
            return f"it is {format_estimate(abs(extra), std)} g {way} than {stated}"
        grams = 10.0 ** round(np.log10(TRIAL_MASS * 1e3 * self.stated))
        change = grams * self.camera.T @ self.per_mass  # mm
        ways = [
            f"{digits(abs(x), 2)} mm further {names[x < 0]}"
            for x, names in zip(change.tolist(), DIRECTIONS)
            if abs(x) > LEAST_SHIFT
        ]
        otherwise = f"; if it weighs {grams:g} g more, it sits {', '.join(ways)}" if ways else ""
        return f"its mass does not show: taken as {stated}{otherwise}"

    def _describe_products(self) -> str:
        """Say that the body's products of inertia are others than stated, or nothing."""
        size = float(np.abs(self.products.change).max(initial=0.0))
        # Where a place does not show, its moments m x y are in the products.
        if (
            not all(self.shift.axes)
            or not self.products.is_significant
            or size < FORM_ERROR * self.moment
        ):
            return ""
        shown = zip(
            ("Ixy", "Ixz", "Iyz"), self.products.change.tolist(), self.products.std.tolist()
        )
        figures = ", ".join(
            f"{name} by {format_estimate(x, s, 2)}"
            for name, x, s in shown
            if abs(x) > DEVIATIONS * s
        )
        meaning = "turning one axis pushes the others more than the URDF says"
        return f"{self.body}: products of inertia differ from the URDF, {figures} kg m^2: {meaning}"

    def to_dict(self) -> dict[str, Any]:
        """Return `given_model` of `diagnose --json`: grams and millimetres, null where nothing is shown."""
        shown = self.shift.axes
        com = 1e3 * self.shift.change
        std = 1e3 * self.shift.std
        mass, mass_std = self.found_mass or (None, None)
        row = {
            "mass": None if mass is None else 1e3 * (mass - self.stated),
            "com_mm": [float(x) if yes else None for x, yes in zip(com, shown)],
            "std": float(max(s for s, yes in zip(std, shown) if yes)) if any(shown) else None,
            "sentence": self.sentence,
            "com_mm_per_g": self.per_mass.tolist(),
            "com_std_mm": [float(s) if yes else None for s, yes in zip(std, shown)],
            "mass_std": None if mass_std is None else 1e3 * mass_std,
            "stated_mass": 1e3 * self.stated,
            "weighed": self.is_weighed,
            "link": self.link,
            "alone": self.is_sufficient,
            "com_std_if_known_mm": finite_or_none(1e3 * self.std_if_known),
        }
        if not (said := self._describe_products()):
            return {"camera": row}
        products = self.products
        figures = zip(
            ("Ixy", "Ixz", "Iyz"), products.axes, products.change.tolist(), products.std.tolist()
        )
        differ = {name: {"value": x, "std": s} for name, yes, x, s in figures if yes}
        return {"camera": row, self.body: {**differ, "sentence": said}}


def _describe_direction(shift: ShownChange, least: float, place: str, there: str, than: str) -> str:
    """Say how far from a place something sits, forward, left and up; a way under `least`, m, is none."""
    change = shift.change
    std = shift.std
    clear = (np.abs(change) > np.maximum(DEVIATIONS * std, least)) & shift.axes
    within = np.maximum(np.abs(change) + DEVIATIONS * std, least)
    if not (shift.is_significant and clear.any()):
        return f"{place}, to {digits(1e3 * float(within.max()), 2)} mm"
    same = [
        f", {a}/{b} {there}, to {digits(1e3 * x, 2)} mm"
        for (a, b), x, yes in zip(DIRECTIONS, within.tolist(), shift.axes & ~clear)
        if yes
    ]
    away = [
        f"{format_estimate(1e3 * abs(x), max(1e3 * s, 0.01))} mm further {names[x < 0]}"
        for x, s, names, yes in zip(change.tolist(), std.tolist(), DIRECTIONS, clear)
        if yes
    ]
    return f"{', '.join(away)}{than}{''.join(same)}"


@dataclass(frozen=True, eq=False)
class RelativePlace:
    """Where a payload's centre of mass sits, relative to that of a known gimbal's as it was found.

    Attributes:
        name: The known payload.
        shift: Forward, left and up as the camera sees them, m.
        masses: Of the payload and of the known one that this stands on, kg.
    """

    name: str
    shift: ShownChange
    masses: tuple[float, float]

    @property
    def sentence(self) -> str:
        """How far it is from that."""
        new, first = (f"{digits(1e3 * mass, 4)} g" for mass in self.masses)
        way = _describe_direction(self.shift, 0.0, "at the same place", "the same", "")
        return (
            f"relative to {self.name} as it was found, at {first} of that and {new} of this: {way}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds: millimetres forward, left and up, grams; null where nothing is shown."""
        columns = zip(
            self.shift.axes, (1e3 * self.shift.change).tolist(), (1e3 * self.shift.std).tolist()
        )
        shown = [(x, s) if yes else (None, None) for yes, x, s in columns]
        return {
            "payload": self.name,
            "com_mm": [x for x, _ in shown],
            "com_std_mm": [s for _, s in shown],
            "masses": [1e3 * mass for mass in self.masses],
            "sentence": self.sentence,
        }


def compare_places(
    own: BaseDifference,
    first: BaseDifference,
    apart: PayloadDiscrepancy,
    name: str,
    weighed: float | None,
    trust: float = TRUST,
) -> RelativePlace | None:
    """``c - c_1 = (h - h_1)/m + (m_1/m - 1) c_1``: where a payload sits, relative to a known gimbal's as it was found.

    Its first moment h differs from h₁ by what the logs tell; that the known payload and the link that carries it share
    theirs in doubt matters only as far as the masses differ. None where nothing shows, or `apart` says the same.

    Args:
        own: What the payload adds to the base parameters in the place of the known one, about the known one's URDF.
        first: The known gimbal with the known payload against its URDF.
        apart: What sets the payload apart from its own URDF.
        name: The known payload.
        weighed: The payload's mass, kg, where it was weighed.
        trust: See `explain_by_payload`.
    """
    body, inertia, frame = get_payload(own.rig)
    mine = slice(10 * body, 10 * body + 10)
    stated = float(inertia.mass)
    mass = apart.known_mass
    whole = apart.stated if mass is None else mass.value
    new = explain_by_payload(own, None if mass is not None and weighed is None else whole, 0.0)
    if new is None or not (new.is_physical and new.found_mass and any(new.shift.axes)):
        return None
    whole = new.found_mass[0]
    turn = new.camera.T
    ratio = stated / whole - 1
    shift = new.shift._replace(basis=turn @ new.shift.basis)
    columns = first.responses[:, mine]
    moments = stated * columns[:, MOMENT_PLACES] @ frame.rotation @ turn.T
    old = _doubt_bodies(first, trust).explain(
        moments, columns[:, INERTIA_PLACES], 1e3
    )  # however loosely
    spread = ratio**2 * shift.basis.T @ old.basis @ old.covariance @ old.basis.T @ shift.basis
    # Of two deviations whose correlation is not known, the sum is no larger than this.
    share = np.sqrt(np.trace(spread) / np.trace(shift.covariance))
    covariance = (1 + share) * shift.covariance + (0 if share == 0 else 1 + 1 / share) * spread
    shift = shift._replace(
        value=shift.value + ratio * shift.basis.T @ old.change, covariance=covariance
    )
    known = apart.shift._replace(basis=turn @ apart.shift.basis)
    apart_too = np.abs(shift.change - known.change) > NORMAL_95 * shift.std
    if (
        known.axes == shift.axes
        and not (apart_too | (known.std > DEVIATIONS * shift.std))[shift.axes].any()
    ):
        return None
    return RelativePlace(name, shift, (whole, stated))


@dataclass(frozen=True, eq=False)
class PayloadStatement:
    """All that a log says of the payload: every verb and page prints this.

    Attributes:
        apart: What sets it apart from its URDF; None where nothing is mounted that is known.
        beside: Where it sits relative to the known gimbal's camera; None where no gimbal was known, or `apart` says it.
        balance: How to balance it, by the same mass; None where nothing is mounted, or the log is of two rigs.
    """

    apart: PayloadDiscrepancy | None = None
    balance: Balance | None = None
    beside: RelativePlace | None = None

    __repr__ = brief

    @property
    def lines(self) -> tuple[str, ...]:
        """Where it sits and what it weighs, in sentences."""
        sentence, *rest = ("",) if self.apart is None else self.apart.lines
        return tuple(
            line
            for line in (sentence, "" if self.beside is None else self.beside.sentence, *rest)
            if line
        )

    @property
    def weighed(self) -> float | None:
        """The payload's mass, kg, if it was given beside the log."""
        mass = None if self.apart is None else self.apart.known_mass
        return mass.value if mass is not None and mass.is_weighed else None

    @property
    def advice(self) -> tuple[str, ...]:
        """How to balance it, in sentences."""
        return () if self.balance is None else self.balance.sentences

    def to_dict(self) -> dict[str, Any]:
        """Return `given_model` and `balance` as JSON holds them, null where there is nothing to say.

        `relative_to_known` is there only where that is said.
        """
        return {
            "given_model": None if self.apart is None else self.apart.to_dict(),
            "balance": None if self.balance is None else self.balance.to_dict(),
            **({} if self.beside is None else {"relative_to_known": self.beside.to_dict()}),
        }


def compare_payload(found: IdentificationResult, mass: float | None = None) -> PayloadStatement:
    """Compare what `identify` found with the rig that it was given; `mass`: the payload's, kg, where it was weighed."""
    if found.is_of_two_rigs:
        return PayloadStatement()
    return state_payload(BaseDifference.of(found), mass, found.trust)


def state_payload(
    found: BaseDifference,
    mass: float | None = None,
    trust: float = TRUST,
    own: BaseDifference | None = None,
) -> PayloadStatement:
    """Say where the payload sits, what it weighs and how to balance it; nothing of a rig without a camera.

    Args:
        found: The refitted base parameters against the given ones.
        mass: Of the payload, kg, where it was weighed.
        trust: See `explain_by_payload`.
        own: The part of the difference that is the payload's, where the gimbal is known.
    """
    if not found.rig.aims:
        return PayloadStatement()
    explained = (
        explain_by_payload(found, mass, trust)
        if own is None
        else explain_by_payload(own, mass, 0.0)
    )
    return PayloadStatement(
        explained, compute_balance(found, None if explained is None else explained.known_mass)
    )


def report_with_payload(found: IdentificationResult, payload: PayloadStatement) -> dict[str, Any]:
    """Return what JSON holds of an identification, and of the payload."""
    return {**found.to_dict(), **payload.to_dict()}


def explain_by_payload(
    found: BaseDifference, weighed: float | None = None, trust: float = TRUST
) -> PayloadDiscrepancy | None:
    """Explain a difference by the payload's ten parameters; None where the rig carries nothing with a mass.

    Inertias are left open: a shift is read from first moments, a mass from what it alone moves (arms that carry it off
    an axis). Torques show the payload together with the bodies that carry it, so what these may differ by from the URDF
    widens all deviations. Where the payload cannot explain the difference, they do differ, by what the trust allows and
    a share more that is estimated, see `_allow_other_bodies`.

    Args:
        found: The refitted base parameters against the given ones.
        weighed: The payload's mass, kg, where it was weighed.
        trust: Relative standard deviation of the bodies' masses beside the payload's (`compute_deformation_root`); none
            of a rig whose YAML says ``inertia: trusted``.

    Raises:
        UsageError: The weighed mass is far from the stated one.
    """
    rig = found.rig
    try:
        body, inertia, frame = get_payload(rig)
    except UsageError:
        return None
    _check_weighed(weighed, float(inertia.mass))
    own = found.responses[:, 10 * body : 10 * body + 10]
    doubted = _doubt_bodies(found, trust)
    std_if_known = np.inf
    if doubted is not found:
        known = explain_by_payload(found, weighed, 0.0)
        std_if_known = (
            float(known.shift.std.max()) if known is not None and any(known.shift.axes) else np.inf
        )
    power, freedom = found.compute_rest(own)
    is_sufficient = freedom == 0 or bool(chi2.sf(power, freedom) > FALSE_ALARM)
    found, open_ = (
        (doubted, own[:, INERTIA_PLACES]) if is_sufficient else _allow_other_bodies(doubted, body)
    )
    asked = _PayloadColumns(found, body, inertia, frame, open_)
    mass = asked.explain_mass(weighed)
    shift, per_mass = asked.explain_shift(mass, weighed is not None)
    products = asked.explain_products(mass, shift, per_mass)
    if not (is_physical := asked.is_physical(mass, shift)):
        mass = mass.hide() if weighed is None else mass
        shift = shift.hide()
        products = products.hide()
        per_mass = np.zeros(3)
    return PayloadDiscrepancy(
        link=find_payload_link(rig),
        body=rig.links[body],
        is_sufficient=is_sufficient,
        stated=asked.stated,
        is_weighed=weighed is not None,
        mass=mass,
        shift=shift,
        per_mass=per_mass,
        products=products,
        camera=np.asarray(frame.rotation.T @ find_camera_axes(rig)),
        gyration=compute_gyration_radius(inertia),
        std_if_known=std_if_known,
        moment=asked.moment,
        is_physical=is_physical,
    )


def _check_weighed(weighed: float | None, stated: float) -> None:
    """Raise `UsageError` for a mass in grams, which is taken for kilograms."""
    if weighed is not None and stated > 0 and not 1 / 30 < weighed / stated < 30:
        what = f"{weighed:g} kg is {digits(weighed / stated, 2)} times what its URDF states"
        raise UsageError(
            "the payload's mass", what, "give it in kilograms, or state it in the payload's URDF"
        )


@dataclass(frozen=True, eq=False)
class _PayloadColumns:
    """The payload's ten parameters as columns, and the difference that they explain.

    Attributes:
        found: The refitted base parameters against the given ones.
        body: Which body carries it, from 0.
        inertia: Its inertia as stated, in that body's joint's frame.
        frame: Its frame there.
        open: What else is left open, (b, m): its own inertias first.
    """

    found: BaseDifference
    body: int
    inertia: pin.Inertia
    frame: pin.SE3
    open: Array

    @property
    def stated(self) -> float:
        """Its mass, kg."""
        return float(self.inertia.mass)

    @property
    def own(self) -> Array:
        """Base parameters per parameter of its body, (b, 10)."""
        return self.found.responses[:, 10 * self.body : 10 * self.body + 10]

    @property
    def heavier(self) -> Array:
        """Base parameters per kilogram that it has more where it is, (b, 1)."""
        return self.own @ (self.inertia.toDynamicParameters() / self.stated)[:, None]

    @property
    def per_metre(self) -> Array:
        """Base parameters per kilogram and metre that it sits elsewhere, in its frame, (b, 3)."""
        return self.own[:, MOMENT_PLACES] @ self.frame.rotation

    @property
    def moment(self) -> float:
        """The body's largest moment of inertia as stated, kg m²."""
        return float(np.linalg.eigvalsh(self.found.rig.model.inertias[self.body + 1].inertia).max())

    def explain_mass(self, weighed: float | None) -> ShownChange:
        """Explain the difference by its mass, wherever it is; one that was weighed is no estimate."""
        if weighed is not None:
            count = len(self.found.change)
            return ShownChange(
                np.eye(1), np.array([weighed - self.stated]), np.zeros((1, 1)), np.zeros((1, count))
            )
        unknown = np.hstack([self.stated * self.per_metre, self.open])
        return self.found.explain(self.heavier, unknown, LEAST_KNOWN * self.stated)

    def explain_shift(self, mass: ShownChange, is_weighed: bool) -> tuple[ShownChange, Array]:
        """Explain the difference by a shift of all of its mass, what it has more included; and per kilogram more."""
        more = float(mass.change[0])
        unsure = self.heavier[:, : len(mass.value) * (not is_weighed)]
        whole = self.stated + more
        limit = LEAST_KNOWN * compute_gyration_radius(self.inertia)

        def place(change: Array, beside: Array, mass: float = whole) -> ShownChange:
            unknown = np.hstack([beside, self.open])
            return replace(self.found, change=change).explain(mass * self.per_metre, unknown, limit)

        change = self.found.change
        heavier = self.heavier[:, 0]
        moved = self.per_metre @ place(change, unsure, self.stated).change * self.stated / whole
        if is_weighed:
            shift = place(change - more * heavier, unsure)
        else:
            shift = place(change + more * moved, unsure + moved[:, None])
        unweighed = -(heavier + moved) * (not len(mass.value))
        return shift, place(unweighed, unsure + moved[:, None]).change

    def change_payload(self, mass: ShownChange, shift: Array, extra: float = 0.0) -> Array:
        """Change of its ten parameters if it has been shifted, and weighs so much more than was found, kg."""
        there = shift_inertia(self.inertia, self.frame, shift).toDynamicParameters()
        whole = self.stated + float(mass.change[0]) + extra
        return np.asarray(there * whole / self.stated - self.inertia.toDynamicParameters())

    def explain_products(
        self, mass: ShownChange, shift: ShownChange, per_mass: Array
    ) -> ShownChange:
        """Explain what shift and mass leave by products of inertia."""
        extra = TRIAL_MASS * self.stated
        own = self.own
        found = self.change_payload(mass, shift.change)
        left = replace(self.found, change=self.found.change - own @ found)
        trial = self.change_payload(mass, shift.change + extra * per_mass, extra)
        hidden = own @ (trial - found)[:, None]  # makes products, too
        beside = [
            np.delete(own, PRODUCT_PLACES, axis=1),
            self.open[:, 6:],
            hidden[:, len(mass.value) :],
        ]
        return left.explain(own[:, PRODUCT_PLACES], np.hstack(beside), LEAST_KNOWN * self.moment)

    def is_physical(self, mass: ShownChange, shift: ShownChange) -> bool:
        """Whether a body can be as was found."""
        rig = self.found.rig
        body = self.body
        total = rig.phi[10 * body : 10 * body + 10] + self.change_payload(mass, shift.change)
        columns = find_base_columns(rig, self.found.reduction)
        about = compute_inertia_regressor(rig, np.zeros((1, rig.n)), body)[0, body, columns]
        off = float(np.linalg.norm(np.cross(find_joint_axis(rig, body), total[MOMENT_PLACES])))
        heavy = self.stated + float(mass.change[0]) > 0
        return heavy and is_physical_inertia(
            float(about @ self.found.refitted), float(total[0]), off
        )


def _doubt_bodies(found: BaseDifference, trust: float) -> BaseDifference:
    """Return the difference, deviations holding what all bodies beside the payload may differ by from the URDF."""
    body, inertia, _ = get_payload(found.rig)
    if trust == 0 or found.rig.config.inertia == "trusted":
        return found
    bare = found.rig.phi.reshape(-1, 10).copy()
    bare[body] -= inertia.toDynamicParameters()
    solid = (
        bare[:, 0] > 1e-3 * inertia.mass
    )  # where nothing carries it, the difference of two sums is rounding
    return found.widen(
        trust
        * found.responses[:, np.repeat(solid, 10)]
        @ compute_deformation_root(bare[solid].ravel())
    )


def _allow_other_bodies(found: BaseDifference, body: int) -> tuple[BaseDifference, Array]:
    """Return the difference, deviations holding what other bodies than one may differ by, and what is open beside it.

    Open are all inertias, as no URDF holds the motors' rotors; where that leaves nothing to judge by, the body's own.
    Masses and first moments are the URDF's, stretched by τ (`compute_deformation_root`), with τ so that what the body
    does not explain is as large as its degrees of freedom (Paule and Mandel, J. Res. Natl. Bur. Stand. 87, 1982).
    """
    mine = np.arange(10 * body, 10 * body + 10)
    own = found.responses[:, mine]
    order = sorted(range(found.rig.n), key=lambda k: k != body)
    open_ = found.responses[:, [10 * k + place for k in order for place in INERTIA_PLACES]]
    if not found.compute_rest(np.hstack([own, open_]))[1]:
        open_ = own[:, INERTIA_PLACES]
    others = found.responses @ np.delete(compute_deformation_root(found.rig.phi), mine, axis=1)
    low, high = 1e-4, 1.0
    for _ in range(12):
        share = float(np.sqrt(low * high))
        power, freedom = found.widen(share * others).compute_rest(np.hstack([own, open_]))
        low, high = (share, high) if power > freedom else (low, share)
    return found.widen(high * others), open_
