"""Gains from a wanted bandwidth or disk margin, with the margins of the sampled, delayed loop."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.control.drive_gains import DriveGains, convert_gains
from gimbal_pin.control.laws import (
    ComputedTorque,
    JointPid,
    Margins,
    ModelErrorBounds,
    Pid,
    Robust,
    bounds,
)
from gimbal_pin.control.laws.chart import LoopCurves, compute_loop_curves
from gimbal_pin.control.laws.computed_torque import CompensatedPid, lyapunov
from gimbal_pin.control.laws.design import (
    Wish,
    braking,
    granted,
    layered,
    lowered,
    seen_inertia,
    small_error_gains,
)
from gimbal_pin.control.laws.reasons import (
    UNSEEN,
    GainReason,
    about_delay,
    about_inertia,
    about_layer,
    about_loops,
    about_model,
    about_sampling,
    doubts,
    group_reasons,
    warn_of_haste,
)
from gimbal_pin.control.laws.uncertainty import DRAWN_MODELS, Ratios, draw_inertia_ratios, widened
from gimbal_pin.dynamics.model import Model, read_model_data
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.errors import ModelError, UsageError, finite_or_none
from gimbal_pin.identification.identified import IdentificationResult
from gimbal_pin.identification.model_file import describe_uncertainty, read_known_parameters
from gimbal_pin.log.io.files import write_yaml
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.files import bundled_rigs
from gimbal_pin.rig.reading import read_yaml
from gimbal_pin.rig.records import LARGEST_NUMBER, bounded_field, prefix_place, read_record
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.structure import SCHEMA, check_origin, describe_structure

TunedLaw = ComputedTorque | JointPid


@dataclass(frozen=True, eq=False)
class Tuning(Record):
    """The answer of `tune`: gains, their margins, and why they are what they are.

    Attributes:
        model: The model it was made for.
        wish: What was asked.
        bandwidth_hz: What was granted, Hz, (n).
        gains: Outer loop, one per joint, in acceleration.
        inertia: Inertia at each joint at home, kg m², (n); a PID's gains are multiplied by it.
        braking: Deceleration that each motor surely has, rad/s², (n): beyond it the outer loop is no longer linear.
        margins: One per joint: the worst over the poses within the limits, the boundary layer's gain included.
        worst: The same, the worst of `draws` models drawn from the covariance included.
        draws: How many were drawn; 0: the model has no covariance, and `worst` is `margins`.
        ratios: Gains of the plant over what the law believes that `worst` is of, one tuple per joint.
        robust: Lyapunov redesign, or None.
        reasons: Why the gains are what they are.
        doubts: Which joints' loops should not be closed, and why; in sentences.
    """

    model: Model
    wish: Wish
    bandwidth_hz: tuple[float, ...]
    gains: tuple[Pid, ...]
    inertia: tuple[float, ...]
    braking: tuple[float, ...]
    margins: tuple[Margins, ...]
    worst: tuple[Margins, ...]
    draws: int
    ratios: Ratios
    robust: Robust | None
    reasons: tuple[GainReason, ...]
    doubts: tuple[str, ...] = ()

    ROWS: ClassVar[str] = "joints"
    __repr__ = brief

    @cached_property
    def controller(self) -> TunedLaw:
        """The control law, ready for `simulate`."""
        return law_of(self.wish, self.model, self.gains, self.inertia, self.braking, self.robust)

    @cached_property
    def drive_gains(self) -> tuple[DriveGains, ...]:
        """The gains at home in the units that drives take, one per joint."""
        rig = self.model.rig
        return tuple(map(convert_gains, self.gains, self.inertia, rig.motors, rig.slides))

    @property
    def stored(self) -> StoredController:
        """What its file holds."""
        return StoredController(
            self.controller,
            self.model,
            self.wish,
            dict(zip(self.model.rig.joints, self.bandwidth_hz)),
            self.model.rig.payload,
        )

    def __str__(self) -> str:
        """A line per joint: gains, bandwidth and margins; `show_controller` has the table."""
        rig = self.model.rig
        rows = zip(rig.joints, self.gains, self.bandwidth_hz, self.margins)
        each = (
            f"{joint}: kp {pid.kp:.4g}, ki {pid.ki:.4g}, kd {pid.kd:.4g}; bandwidth {hz:.3g} Hz, margins: phase "
            f"{found.phase_margin_deg:.3g}°, gain {found.gain_margin_db:.3g} dB, disk {found.disk_margin:.3g}"
            for joint, pid, hz, found in rows
        )
        warned = (f"warning: {said}" for said in self.warnings)
        return "\n".join(
            [
                f"{self.wish.kind} for {rig.name}",
                *warned,
                *each,
                *self.doubts,
                *map(str, self.reasons),
            ]
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What of the model does not hold for data that it was not fitted to, and a delay that is not the logs'."""
        return (*map(str, self.model.doubts), *warn_of_haste(self.model, self.wish))

    def with_(self, **changes: Any) -> Tuning:
        """Tune again with some wishes changed: ``tuning.with_(bandwidth_hz=12)``."""
        known = [f.name for f in fields(Wish)]
        for name in changes:
            if name not in known:
                raise UsageError("with_", f"knows no '{name}'", f"change {', '.join(known)}")
        return tune(self.model, **{**vars(self.wish), **changes})

    @cached_property
    def loop_curves(self) -> tuple[LoopCurves, ...]:
        """Every joint's loop as it is drawn: its response, and the answer to a disturbance."""
        loops = small_error_gains(self.gains, self.robust)
        wish = self.wish
        model = self.model
        return compute_loop_curves(
            model.rig.joints, loops, self.worst, wish.dt, wish.delay, model.drives, self.ratios
        )

    @check_arguments
    def save(self, path: str | Path) -> None:
        """Write it as ``gimbal-pin tune -o`` does: `read_controller`, ``track`` and ``export`` take the file."""
        write_controller(self, path, Path(path).parent)

    def to_dict(self) -> dict[str, Any]:
        """Return what `tune` writes as JSON and YAML; `stored` reads it back.

        Gains are in acceleration (1/s², 1/s³, 1/s), whatever the kind; `drive` has them as `DriveGains`.
        `bandwidth_hz` is the granted one, `crossover_hz` where the loop's gain is one. Infinite margins are null, and
        so is `worst_of_draws` where the model has no covariance.
        """
        rig = self.model.rig
        wish = self.wish
        law = self.robust
        rows = zip(
            *(
                rig.joints,
                self.gains,
                self.margins,
                self.worst,
                self.bandwidth_hz,
                self.inertia,
                self.braking,
            ),
            self.drive_gains,
        )
        wanted = wish.bandwidth_hz
        return {
            "schema": SCHEMA,
            "controller": wish.kind,
            "rig": rig.name,
            "payload": rig.payload,
            "structure": describe_structure(rig),
            "joints": {
                joint: {
                    **pid._asdict(),
                    **finite(
                        {
                            **asdict(found),
                            "bandwidth_hz": hz,
                            "inertia": moment,
                            "braking": deceleration,
                        }
                    ),
                    "worst_of_draws": finite(asdict(least)) if self.draws else None,
                    "drive": {name: one and one._asdict() for name, one in vars(drive).items()},
                }
                for joint, pid, found, least, hz, moment, deceleration, drive in rows
            },
            "draws": self.draws,
            "wish": {
                **vars(wish),
                "bandwidth_hz": dict(wanted) if isinstance(wanted, Mapping) else wanted,
            },
            "robust": None if law is None else law.to_dict(),
            "warnings": list(self.warnings),
            "reasons": list(map(str, self.reasons)),
            "doubts": list(self.doubts),
            "model": {**self.model.to_dict(), **describe_uncertainty(self.model.estimated)},
        }


def write_controller(tuning: Tuning, path: str | Path, folder: str | Path) -> None:
    """Write a controller, with its rig's file as seen from the controller's `folder`, unless the rig is bundled."""
    source = tuning.model.rig.source
    named = {} if source in ("", *bundled_rigs()) else {"rig_file": os.path.relpath(source, folder)}
    write_yaml({**named, **tuning.to_dict()}, path)


@dataclass(frozen=True, eq=False)
class TuningBasis:
    """What tuning needs to know of a model, whatever is wished: worked out once, it serves many wishes.

    Attributes:
        model: The model.
        kind: "computed-torque" or "pid".
    """

    model: Model
    kind: str = "computed-torque"

    __repr__ = brief

    @cached_property
    def inertia(self) -> tuple[tuple[float, ...], Ratios]:
        """See `seen_inertia`."""
        return seen_inertia(self.model, self.kind)

    @cached_property
    def drawn(self) -> Ratios | None:
        """See `draw_inertia_ratios`."""
        return draw_inertia_ratios(self.model, self.kind, np.random.default_rng(0))

    @cached_property
    def ratios(self) -> Ratios:
        """Gains of the plant over what the law believes, at all poses and of all draws, one tuple per joint."""
        return widened(self.inertia[1], self.drawn)

    @cached_property
    def bounds(self) -> ModelErrorBounds | None:
        """How far the model may be off; None for a PID, which does without."""
        return (
            bounds(self.model, np.random.default_rng(0)) if self.kind == "computed-torque" else None
        )

    @cached_property
    def braking(self) -> tuple[float, ...]:
        """See `braking`."""
        return braking(self.model)


@limit_to_one_thread()
@check_arguments
def tune(
    model: Model | IdentificationResult,
    *,
    bandwidth_hz: float | Mapping[str, float] | None = None,
    damping: float = 1.0,
    delay: float | None = None,
    dt: float | None = None,
    kind: str = "computed-torque",
    integral: float = 0.2,
    disk_margin: float | None = None,
    robust: bool = False,
    basis: TuningBasis | None = None,
) -> Tuning:
    """Place the error's poles, ``(s² + 2 ζ ω s + ω²)(s + γ ω)``, and check the margins of the sampled, delayed loop.

    Asked for a disk margin, it finds each joint's highest bandwidth that keeps it; asked for a bandwidth, it lowers
    that until the disk margin is kept, and says so. Both hold for the worst of `DRAWN_MODELS` models drawn from the
    covariance, the drive's lags and delays included.

        fit = identify(rig, log)
        tuning = tune(fit, disk_margin=1.0, delay=0.001)
        log = simulate(fit.model, tuning.controller, reference, rng=rng)

    Args:
        model: The model to invert, or a fit, whose model it is; a PID takes only its inertias.
        bandwidth_hz: ω/2π, Hz: one for all joints, or joint → Hz. The loop's gain is one at about 2 ζ times that.
            None: the highest that keeps `disk_margin`, or 8 Hz where that is None too.
        damping: ζ.
        delay: Time from measurement to torque, s, without the hold; it need not be whole samples. None: one sample, or
            as late as the model's logs show a drive to act.
        dt: Sampling interval, s. None: that of the logs that the model is of, or 1 ms where nobody knows it.
        kind: "computed-torque" or "pid".
        integral: γ; 0: no integral action.
        disk_margin: Balanced disk margin (0 … 2) that every joint's loop keeps. None: 0.5, and for the believed model
            alone where no bandwidth keeps that for all drawn ones.
        robust: True adds Lyapunov redesign, its boundary layer as thin as the disk margin lets it be.
        basis: What is known of this model and kind, where it serves several wishes; None: it is worked out.

    Raises:
        UsageError: A wish that cannot be: a bandwidth that is not positive, an unknown kind or joint, a disk margin
            that no bandwidth keeps, α ≥ 1.
    """
    if isinstance(model, IdentificationResult):
        model = model.model
    model.check_uncoupled("the controller")
    logged = None if model.estimated is None else model.estimated.dt
    wish = Wish.of(
        model,
        dt,
        bandwidth_hz=bandwidth_hz,
        damping=damping,
        delay=delay,
        kind=kind,
        integral=integral,
        disk_margin=disk_margin,
        robust=robust,
    )
    basis = basis or TuningBasis(model, kind)
    if basis.model is not model or basis.kind != kind:
        raise UsageError("basis", "is of another model or kind", "give that of this one, or none")
    rig = model.rig
    (nominal, believed) = basis.inertia
    over = basis.drawn
    ratios = basis.ratios
    drives = model.drives
    rows = list(zip(wish.per_joint(model.rig), believed, ratios, drives))
    hertz, kept = zip(*granted(wish, rows))
    gains = tuple(wish.gains(hz) for hz in hertz)
    known = basis.bounds
    law = layered(gains, known, wish, kept, drives) if robust and known is not None else None
    found, least = (
        tuple(map(wish.margins, small_error_gains(gains, law), of, drives))
        for of in (believed, ratios)
    )
    reasons = [] if dt else [about_sampling(wish, logged)]
    reasons += about_delay(model, wish) if delay is None else []
    reasons += about_loops(model, wish, hertz, found, least if over is not None else None)
    if known is None:
        inertias = [rig.in_units(joint, "kg m²") for joint in rig.joints]
        reasons += group_reasons(
            rig.joints, [about_inertia(*row) for row in zip(nominal, believed, inertias)]
        )
    else:
        reasons += [about_model(known, rig.force)] + ([about_layer(law)] if robust else [])
    draws = 0 if over is None else DRAWN_MODELS
    brakes = basis.braking
    unsure = () if over is None else doubts(model.rig.joints, over, least)
    unseen = group_reasons(
        [one.joint for one in model.doubts if one.unsafe], [UNSEEN] * len(model.doubts)
    )
    unsure += tuple(map(str, unseen))
    return Tuning(
        model,
        wish,
        hertz,
        gains,
        nominal,
        brakes,
        found,
        least,
        draws,
        ratios,
        law,
        tuple(reasons),
        unsure,
    )


def law_of(
    wish: Wish,
    model: Model,
    gains: tuple[Pid, ...],
    inertia: tuple[float, ...],
    brakes: tuple[float, ...],
    robust: Robust | None,
) -> TunedLaw:
    """Return the control law of a kind."""
    if wish.kind == "pid":
        return JointPid(
            gains, inertia, tuple(model.tau_max.tolist()), wish.dt, brakes, model.rig.continuous
        )
    lead = wish.delay + wish.dt / 2
    return ComputedTorque(model, gains, wish.dt, lead=lead, braking=brakes, robust=robust)


RIVAL = "compensated-pid"
"""What a controller is compared with; see `pair_rivals`."""


def pair_rivals(tuned: StoredController) -> dict[str, TunedLaw]:
    """Return a controller under its kind, and beside it a PID with gravity and friction fed forward.

    Each joint of the PID has the highest bandwidth that keeps the disk margin which the controller has, both for the
    worst of the models drawn from the covariance; the controller's bandwidth where none keeps it.
    """
    law = tuned.law
    model = tuned.model
    wish = tuned.wish
    own = TuningBasis(model, wish.kind)
    rival = TuningBasis(model, "pid")
    loops = small_error_gains(law.gains, law.robust if isinstance(law, ComputedTorque) else None)
    gains = []
    for pid, loop, known, ratios, drive in zip(
        law.gains, loops, own.ratios, rival.ratios, model.drives
    ):
        disk = min(max(wish.smallest(loop, known, drive), 0.01), 1.99)
        hz = lowered(inf, replace(wish, disk_margin=disk, robust=False), ratios, drive)
        gains.append(pid if hz is None else wish.gains(hz))
    moments = tuple((np.array(rival.inertia[0]) - model.armature).tolist())
    lead = wish.delay + wish.dt / 2
    pid_law = CompensatedPid(
        model, tuple(gains), wish.dt, lead=lead, braking=rival.braking, inertia=moments
    )
    return {wish.kind: law, RIVAL: pid_law}


@dataclass(frozen=True)
class StoredJoint:
    """What `Tuning.to_dict` writes of a joint, as far as its law needs it; see there."""

    kp: float = bounded_field(MISSING, 1e-6, 1e10)  # from a millihertz to 16 kHz
    ki: float = bounded_field(MISSING, 0.0, 1e16)
    kd: float = bounded_field(MISSING, 1e-6, 1e6)
    inertia: float = bounded_field(MISSING, 1e-12, LARGEST_NUMBER)
    braking: float | None = bounded_field(MISSING, 1e-9, LARGEST_NUMBER)
    bandwidth_hz: float | None = bounded_field(None, 1e-9, LARGEST_NUMBER)


@dataclass(frozen=True)
class Layer:
    """The same of Lyapunov redesign."""

    gain: float
    alpha: float
    phi: float = bounded_field(MISSING, 0.0, LARGEST_NUMBER)
    inverse: float = bounded_field(MISSING, 0.0, LARGEST_NUMBER)
    source: str = ""


@dataclass(frozen=True)
class Filed:
    """The same of all."""

    controller: str
    joints: Mapping[str, Any]
    wish: Wish
    robust: Any
    model: Any


@dataclass(frozen=True, eq=False)
class StoredController:
    """A controller from a file.

    Attributes:
        law: The control law.
        model: The model that it was made for.
        wish: What was asked.
        bandwidth_hz: Joint → what was granted, Hz, or None where the file does not say.
        payload: Payload that it was tuned for, which need not be the one that the rig carries here.
    """

    law: TunedLaw
    model: Model
    wish: Wish
    bandwidth_hz: Mapping[str, float | None]
    payload: str | None = None

    __repr__ = brief


def stored(data: Any, rig: Rig, place: str = "controller") -> StoredController:
    """Return the controller that `Tuning.to_dict` wrote, on the same rig; `place` is the file.

    Raises:
        ModelError: A key is missing or holds the wrong kind of value, the rig is another one, or a loop that the gains
            close is unstable even with an exact model.
    """
    if not isinstance(data, dict) or data.get("wish") is None:
        raise ModelError(
            place, "holds no controller", "make one from a model: gimbal-pin tune RIG MODEL -o FILE"
        )
    with prefix_place(place, ModelError):
        filed = read_record(Filed, data, place, ModelError, others=True)
        if set(filed.joints) != set(rig.joints):
            what = f"is for the joints {', '.join(filed.joints)}"
            raise ModelError(
                place, what, f"the rig {rig.name} has {', '.join(rig.joints)}: tune for it"
            )
        check_origin(data, rig, place)
        wish = filed.wish
        if filed.controller != wish.kind:
            what = f"is '{filed.controller}', and the wish is for {wish.kind}"
            raise ModelError(f"{place}: controller", what, "write it with 'gimbal-pin tune'")
        wish.per_joint(rig)
        rows = [
            read_record(
                StoredJoint, filed.joints[j], f"{place}: joints.{j}", ModelError, others=True
            )
            for j in rig.joints
        ]
        gains = tuple(Pid(row.kp, row.ki, row.kd) for row in rows)
        for joint, pid in zip(rig.joints, gains):
            # Routh's bound of s³ + kd s² + kp s + ki, and a damping ratio, each with a margin that Lyapunov's needs.
            if not (pid.ki <= 0.99 * pid.kp * pid.kd and pid.kd**2 >= 1e-6 * pid.kp):
                mend = "give kp kd well above ki, and kd well above a thousandth of √kp"
                raise ModelError(f"{place}: joints.{joint}", "has unstable gains", mend)
        inertia = tuple(row.inertia for row in rows)
        brakes = tuple(inf if row.braking is None else row.braking for row in rows)
        model = read_model_data(filed.model, rig, f"{place}: model")
        if "covariance" in filed.model:
            model = replace(
                model, estimated=read_known_parameters(filed.model, f"{place}: model", rig.n)
            )
        robust = (
            None
            if filed.robust is None
            else read_robust_term(filed.robust, gains, f"{place}: robust")
        )
        law = law_of(wish, model, gains, inertia, brakes, robust)
        granted_hz = {joint: row.bandwidth_hz for joint, row in zip(rig.joints, rows)}
        return StoredController(law, model, wish, granted_hz, data.get("payload", rig.payload))


def read_controller(path: str | Path, rig: Rig) -> StoredController:
    """Read a controller's YAML for its rig; errors as `stored`."""
    return stored(read_yaml(path, ModelError), rig, str(path))


def read_robust_term(data: Any, gains: tuple[Pid, ...], place: str) -> Robust:
    """Return the robust term that `Robust.to_dict` wrote, for loops of these gains; `place` names it in errors."""
    layer = read_record(Layer, data, place, ModelError, others=True)
    return Robust(
        lyapunov(gains),
        ModelErrorBounds(layer.alpha, layer.phi, layer.inverse, layer.source),
        layer.gain,
    )


def finite(values: Mapping[str, float]) -> dict[str, float | None]:
    """Return the values with null for what JSON cannot say."""
    return {key: finite_or_none(value) for key, value in values.items()}
