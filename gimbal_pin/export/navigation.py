"""Navigation in casadi's symbols: where the camera looks and should look, and the motion of the joints for that."""

from __future__ import annotations

from functools import reduce
from types import SimpleNamespace
from typing import TYPE_CHECKING

from gimbal_pin.export.equations import Equations
from gimbal_pin.export.symbolic import Chain, Symbols

if TYPE_CHECKING:
    import casadi


class NavigationEquations(Equations):
    """Functions of one sample on the way from the sensors to an aim, attitudes as quaternions (w, x, y, z)."""

    def __init__(self, chain: Chain) -> None:
        """Take the camera's kinematics."""
        super().__init__(chain)
        self.camera, self.drift, self.between = chain.camera(), chain.drift(), chain.between()
        self.first = (
            0 if chain.n > 2 else 1
        )  # of two axes those across the line of sight are commanded
        self.undone = f"view_against:{3 * chain.n}"

    def list_functions(self) -> list[tuple[casadi.Function, str]]:
        """Return all of them, and what they are."""
        looks = (
            self.chain.between,
            self.build_camera_rate,
            self.build_view,
            self.build_approach,
            self.build_gaze,
        )
        motion = (
            self.build_level,
            self.build_fusion,
            self.build_aim,
            self.build_trust,
            self.build_wish,
        )
        return self.describe(*looks, *motion)

    def build_camera_rate(self) -> casadi.Function:
        """What a gyro beside the camera reads, rad/s: rates v on a base that turns with w: see `Sight.rate`."""
        x = self.declare("q v w:3")
        R, J = self.look(x.q)
        return self.function("camera_rate", x, rate=R.T @ x.w + J @ x.v)

    def build_view(self) -> casadi.Function:
        """The camera's attitude, and the joints' rates that undo its turns: see `Sight.view`."""
        x = self.declare("limits_steep limits_damping q")
        R, against, fine = self.view(x.limits_steep, x.limits_damping, x.q)
        rows = self.chain.rows
        return self.function(
            "view",
            x,
            view_R=rows(R),
            view_against=rows(against),
            view_steep=self.ca.logic_not(fine),
        )

    def build_approach(self) -> casadi.Function:
        """A step of Newton towards an attitude, at most `stride`, from known angles: see `Sight.reached`."""
        ca = self.ca
        x = self.declare(f"{self.undone} base:4 to:4 q stride")
        left = self.chain.log(self.chain.product(x.base, x.to))
        step = self.undo(x) @ left
        scaled = x.q + step * ca.fmin(1, x.stride / ca.fmax(ca.mmax(ca.fabs(step)), 1e-12))
        return self.function(
            "approach", x, q_next=scaled, left=ca.mmax(ca.fabs(left[self.first :]))
        )

    def build_gaze(self) -> casadi.Function:
        """Where the camera should look so long after the start of a turn: see `Turn.progress` and `Turn.gaze`."""
        ca = self.ca
        x = self.declare("way_base:4 way_goal way_way way_rate way_ramp since")
        rate = x.way_rate
        ramp = x.way_ramp
        still = ca.SX(3, 1)
        left = ca.fmax(1 / rate + ramp - x.since, 0)
        near = ca.fmin(x.since, left)
        rises = x.since < left
        part = ca.fmin(near / ramp, 1)
        gone = rate * (ramp * part**3 * (1 - part / 2) + ca.fmax(near - ramp, 0))
        q = x.way_goal + ca.if_else(rises, gone - 1, -gone) * x.way_way
        v = rate * part**2 * (3 - 2 * part) * x.way_way
        a = rate / ramp * 6 * part * (1 - part) * ca.if_else(rises, 1, -1) * x.way_way
        _, J = self.look(q)
        looks = self.chain.product(x.way_base, self.between(q)[:4])
        return self.function(
            "gaze",
            x,
            gaze_attitude=looks,
            gaze_w=J @ v,
            gaze_dw=self.drift(q, v, still, still) + J @ a,
        )

    def build_level(self) -> casadi.Function:
        """Attitude with what levels it, in the frame that is wanted for the camera, and the means: see `Level.step`."""
        ca = self.ca
        x = self.declare(
            "p_dt p_gravity p_level_span upright_up:3 upright_eased upright_samples upright_means:9 to:4 f:3 camera:4"
        )
        up = x.upright_up
        means = ca.reshape(x.upright_means, 3, 3)
        world = self.chain.product(x.camera, self.chain.inverse(x.to))
        force = self.chain.product(
            self.chain.product(world, ca.vertcat(0, x.f)), self.chain.inverse(world)
        )[1:]
        count = ca.fmin(x.upright_samples + 1, x.p_level_span)
        for k in range(3):
            means[:, k] += (3 + k) / (count + 2 + k) * (force - x.p_gravity * up - means[:, k])
        mean = means @ ca.SX([10, -15, 6])
        part = ca.fmin(count * x.p_dt / x.upright_eased, 1)
        axis = ca.cross(mean, up)
        size = ca.norm_2(axis)
        height = ca.dot(mean, up) + x.p_gravity
        half = (part * part * (3 - 2 * part)) ** 2 * ca.atan2(size, height) / 2
        turn = ca.vertcat(ca.cos(half), ca.sin(half) / ca.fmax(size, 1e-12) * axis)
        after = dict(upright_samples_next=count, upright_means_next=ca.vec(means))
        return self.function("level", x, **after, camera_next=self.chain.product(turn, x.camera))

    def build_fusion(self) -> casadi.Function:
        """Gap between the camera's attitude and what another gyro makes of it: see `Fusion.compared`."""
        x = self.declare(
            "p_fusion_gain p_fusion_share p_fusion_bound own:4 other:4 to:4 gap:3 slow:3"
        )
        product = self.chain.product
        inverse = self.chain.inverse
        seen = self.chain.log(product(inverse(x.own), product(x.other, x.to)))
        gap = x.gap + x.p_fusion_gain * (seen - x.gap)
        slow = x.slow + x.p_fusion_share * (gap - x.slow)
        apart = self.ca.mmax(self.ca.fabs(gap - slow)) - x.p_fusion_bound
        return self.function("fusion", x, gap_next=gap, slow_next=slow, apart=apart)

    def build_aim(self) -> casadi.Function:
        """Joint rates by the gyros, and where the joints should be: see `Navigator.fix`."""
        ca = self.ca
        x = self.declare(
            f"view_R:9 {self.undone} gaze_attitude:4 gaze_w:3 seen_q seen_camera_gyro:3 seen_base_gyro:3 "
            "actual:4 rate:3"
        )
        against = self.undo(x)
        carried = ca.reshape(x.view_R, 3, 3) @ x.seen_base_gyro
        turn = self.chain.log(self.chain.product(self.chain.inverse(x.gaze_attitude), x.actual))
        aim = dict(aim_q=x.seen_q + against @ turn, aim_v=against @ (carried + x.rate - x.gaze_w))
        return self.function("aim_joints", x, **aim, v=against @ (carried - x.seen_camera_gyro))

    def build_trust(self) -> casadi.Function:
        """How far the forecast is trusted by what came due: see `Forecast.held` and `Forecast.compared`."""
        ca = self.ca
        x = self.declare(
            "p_dt judging_slow judging_mean judging_rise judging_fall now:6 before:6 due:12 "
            "state_slow_errors:12 state_scores:8 state_trust"
        )
        mean = (x.now + x.before) / 2
        change = (x.now[:3] - x.before[:3]) / x.p_dt
        errors = x.due - ca.repmat(ca.vertcat(change, mean[3:]), 2)
        slow = x.state_slow_errors + x.judging_slow * (errors - x.state_slow_errors)
        squares = [
            ca.sum1(ca.reshape(y * y, 3, 4)) for y in (errors, slow)
        ]  # dw and f foreseen, dw and f held
        found = ca.horzcat(squares[0][:2], squares[1][:2], squares[0][2:], squares[1][2:]).T
        scores = x.state_scores + x.judging_mean * (found - x.state_scores)
        better = reduce(ca.logic_and, ca.vertsplit(scores[:4] < scores[4:]))
        trust = x.state_trust
        trust = ca.if_else(
            better, ca.fmin(1, trust + x.judging_rise), ca.fmax(0, trust - x.judging_fall)
        )
        after = dict(state_slow_errors_next=slow, state_scores_next=scores, state_trust_next=trust)
        return self.function("trust", x, **after, none_w=mean[:3], none_dw=change, none_f=mean[3:])

    def build_wish(self) -> casadi.Function:
        """A forecast as far as it is trusted, and the joints' rates and accelerations: see `Navigator.ahead`."""
        x = self.declare(
            f"state_trust view_R:9 {self.undone} gaze_w:3 gaze_dw:3 none_w:3 none_dw:3 none_f:3 "
            "there_q there_w:3 there_dw:3 there_f:3"
        )
        pairs = [(x.none_w, x.there_w), (x.none_dw, x.there_dw), (x.none_f, x.there_f)]
        w, dw, f = (none + x.state_trust * (there - none) for none, there in pairs)
        v = self.undo(x) @ (self.ca.reshape(x.view_R, 3, 3) @ w - x.gaze_w)
        a = self.undo(x) @ (self.drift(x.there_q, v, w, dw) - x.gaze_dw)
        after = dict(there_w_next=w, there_dw_next=dw, there_f_next=f)
        return self.function("wish", x, **after, there_v=v, there_a=a)

    def look(self, q: Symbols) -> tuple[Symbols, Symbols]:
        """Attitude of the camera, (3, 3), and Jacobian of its rate, (3, n)."""
        R, J = self.camera(q)
        return self.ca.reshape(R, 3, 3).T, self.ca.reshape(J, self.chain.n, 3).T

    def undo(self, x: SimpleNamespace) -> Symbols:
        """Rates of the joints that undo a turn of the camera, of a view that is known, (n, 3)."""
        return self.ca.reshape(x.view_against, 3, self.chain.n).T

    def view(
        self, steepest: Symbols, damping: Symbols, q: Symbols
    ) -> tuple[Symbols, Symbols, Symbols]:
        """Attitude, rates of the joints that undo a turn of the camera, (n, 3), and whether they are exact."""
        ca = self.ca
        (R, whole) = self.look(q)
        J = whole[self.first :, :]
        m, n = J.shape
        own = J @ J.T
        damped = J.T @ ca.inv_minor(own + damping**2 * ca.SX.eye(m))
        if n == 3:
            exact = ca.inv_minor(J)
            size = ca.fabs(ca.det(J))
            most = ca.mmax(ca.fabs(ca.adj(J)))
            fine = ca.logic_and(most < steepest * size, size > 1e-9)
        else:
            exact = J.T @ ca.inv_minor(own)
            fine = ca.logic_and(
                ca.mmax(ca.fabs(exact)) < steepest, ca.det(own) > steepest ** (-2 * m)
            )
        inverse = ca.if_else(fine, exact, damped)
        return R, ca.horzcat(ca.SX(n, self.first), -inverse), fine
