"""The control laws in casadi's symbols: errors and feedback, the model's torque, the cut to the limits."""

from __future__ import annotations

from collections.abc import Callable
from inspect import getdoc
from math import pi
from types import SimpleNamespace
from typing import TYPE_CHECKING

from gimbal_pin.dynamics.model import Model
from gimbal_pin.export.ccode import SCALARS
from gimbal_pin.export.symbolic import Chain, Symbols, terms
from gimbal_pin.regression import compute_direction

if TYPE_CHECKING:
    import casadi


class Equations:
    """Functions of what C's structures hold: `loop_kp` is ``loop[j].kp``, `there_q` is ``there->q``.

    Attributes:
        chain: The rig's bodies.
    """

    def __init__(self, chain: Chain) -> None:
        """Take the rig."""
        self.chain, self.ca = chain, chain.ca

    def declare(self, names: str) -> SimpleNamespace:
        """Return a symbol per name: scalars, `NAME:SIZE`, or one entry per joint."""
        found = [name.split(":") for name in names.split()]
        sizes = {
            name: int(*size) if size else 1 if name in SCALARS else self.chain.n
            for name, *size in found
        }
        return SimpleNamespace(**{name: self.ca.SX.sym(name, size) for name, size in sizes.items()})

    def describe(
        self, *builders: Callable[[], casadi.Function]
    ) -> list[tuple[casadi.Function, str]]:
        """Return the functions, each with what its builder says of it, which C says, too."""
        return [(build(), getdoc(build) or "") for build in builders]

    def function(self, name: str, x: SimpleNamespace, **outputs: Symbols) -> casadi.Function:
        """Return a function of the declared symbols."""
        return self.chain.function(name, vars(x), outputs)


class LawEquations(Equations):
    """The laws that follow a reference and hold the camera.

    Attributes:
        robust: Whether there is Lyapunov redesign.
        values: Coefficients of the terms that are not affine.
    """

    def __init__(self, chain: Chain, model: Model, robust: bool) -> None:
        """Take the torque of the bodies and of the terms."""
        super().__init__(chain)
        self.robust, self.model, self.torque, (self.terms, self.values) = (
            robust,
            model,
            chain.torque(),
            terms(model),
        )
        others = self.terms.numel_in(0)
        self.coefficients = f"terms_constant terms_per_slide terms_per_rate terms_others:{others}"

    def list_functions(self) -> list[tuple[casadi.Function, str]]:
        """Return all of them, and what they are."""
        builders = (
            self.build_moving_torque,
            self.build_standing_torque,
            self.build_feedback,
            self.build_cut,
        )
        return self.describe(*builders)

    def build_feedback(self) -> casadi.Function:
        """Errors with this sample, and what the loops ask for against them, rad/s^2; wished: accelerations.

        See `Outer.feedback` and `Robust.correction`.
        """
        ca = self.ca
        norm = self.ca.norm_2
        x = self.declare(
            f"p_dt loop_kp loop_ki loop_kd loop_knee loop_braking robust_direction:{3 * self.chain.n} robust_alpha "
            "robust_disturbance robust_gain q v goal_q goal_v integral wished"
        )
        e = x.goal_q - x.q
        rate = x.goal_v - x.v
        if any(
            self.model.rig.continuous
        ):  # the shorter way round: an encoder that wraps is no error of a turn
            turn = 2 * pi * ca.DM([float(endless) for endless in self.model.rig.continuous])
            e -= turn * ca.floor(e / (2 * pi) + 0.5)
        total = x.integral + x.p_dt * e
        size = ca.fabs(e)
        far = x.loop_kd * ca.sqrt(x.loop_braking * (2 * size - x.loop_knee))
        pull = ca.if_else(size <= x.loop_knee, x.loop_kp * e, ca.copysign(far, e))
        y = x.loop_ki * total + x.loop_kd * rate + pull
        if self.robust:
            z = ca.sum2(
                ca.reshape(x.robust_direction, 3, self.chain.n).T * ca.horzcat(total, e, rate)
            )
            most = (x.robust_alpha * (norm(x.wished) + norm(y)) + x.robust_disturbance) / (
                1 - x.robust_alpha
            )
            y += z * ca.if_else(x.robust_gain * norm(z) <= most, x.robust_gain, most / norm(z))
        return self.function(
            "feedback", x, error_angle=e, error_rate=rate, error_integral=total, y=y
        )

    def build_moving_torque(self) -> casadi.Function:
        """Torque of the model on a base that moves, N m, y on top of wanted accelerations: see `CarriedTorque.at`."""
        x = self.declare(
            f"p_dt {self.coefficients} t there_q there_v there_a there_f:3 there_w:3 there_dw:3 y"
        )
        q = x.there_q
        v = x.there_v
        a = x.there_a + x.y
        base = (x.there_f, x.there_w, x.there_dw)
        slide = compute_direction(v, x.there_a, x.p_dt)
        rest = self.torque(q, v, a, *base) + self.sum_affine_terms(x, slide, v)
        weight = self.torque(q, 0, 0, *base) if self.model.weighed else rest
        return self.function(
            "moving_torque",
            x,
            tau=rest + self.sum_other_terms(x, (q, v, a, slide), rest, weight, 0),
        )

    def build_standing_torque(self) -> casadi.Function:
        """Torque of the model on a base that stands upright with the joints accelerating by y, N m.

        Dry friction is that of the reference's direction: see `ComputedTorque.inverse`.
        """
        x = self.declare(
            f"p_tracking_lead p_still p_gravity {self.coefficients} t q v y reference_v reference_a"
        )
        q = x.q + x.p_tracking_lead * x.v
        rate = x.reference_v + x.p_tracking_lead * x.reference_a
        base = (self.ca.vertcat(0, 0, x.p_gravity), 0, 0)
        slide = self.ca.if_else(self.ca.fabs(rate) < x.p_still, 0, self.ca.copysign(1, rate))
        rigid = self.torque(q, x.v, x.y, *base)
        known = self.sum_affine_terms(x, slide, rate)
        weight = self.torque(q, 0, 0, *base) if self.model.weighed else rigid
        return self.function(
            "standing_torque",
            x,
            tau=rigid + self.sum_other_terms(x, (q, rate, x.y, slide), rigid, weight, known),
        )

    def build_cut(self) -> casadi.Function:
        """Torques within the limits, N m, and the integrals that are kept: see `Outer.integrated`, `Outer.clipped`."""
        ca = self.ca
        x = self.declare("p_limit loop_knee error_angle error_integral wanted integral")
        further = ca.logic_and(ca.fabs(x.wanted) > x.p_limit, x.wanted * x.error_angle > 0)
        held = ca.logic_or(further, ca.fabs(x.error_angle) > x.loop_knee)
        # What is no number stays none, for the caller to see.
        tau = ca.if_else(ca.fabs(x.wanted) > x.p_limit, ca.copysign(x.p_limit, x.wanted), x.wanted)
        return self.function(
            "cut_torque", x, integral_next=ca.if_else(held, x.integral, x.error_integral), tau=tau
        )

    def sum_affine_terms(self, x: SimpleNamespace, slide: Symbols, rate: Symbols) -> Symbols:
        """Torque of the affine terms, N m."""
        return x.terms_constant + x.terms_per_slide * slide + x.terms_per_rate * rate

    def sum_other_terms(
        self,
        x: SimpleNamespace,
        at: tuple[Symbols, ...],
        rest: Symbols,
        weight: Symbols,
        known: Symbols,
    ) -> Symbols:
        """Torque of all other terms, with what is known of it, where the rest asks for `rest`, N m.

        See `compute_added_torque`, whose iteration stands here without its branches.
        """
        found = [rest * 0]
        for _ in range(3 if self.model.loaded else 1):
            found.append(known + self.terms(x.terms_others, x.t, *at, rest + found[-1], weight))
        if not self.model.loaded:
            return found[-1]
        last = found[3] - found[2]
        change = found[2] - found[1]
        slope = self.ca.if_else(change != 0, last / change, 0)
        return found[3] + self.ca.if_else(self.ca.fabs(slope) < 1, last * slope / (1 - slope), 0)
