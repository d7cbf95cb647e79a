"""The optimisation behind an excitation: a criterion of a motion's coefficients under limits, with exact gradients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation.clearance import Clearance
from gimbal_pin.excitation.columns import ExcitationColumns
from gimbal_pin.excitation.criteria import Criterion
from gimbal_pin.excitation.fourier import Series
from gimbal_pin.excitation.limits import Envelope, find_crest
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import compute_direction


@dataclass(frozen=True, eq=False)
class ExcitationProblem:
    """Minimise ``criterion(W(x)) + 100 deficit(x)`` subject to ``shares(x) <= 1``; x: the free coefficients, flat.

    Attributes:
        model: Rig and torques (friction included) that the limits are checked with.
        series: The Fourier series; x are its coefficients in the basis `Series.rest`.
        columns: What is to be seen.
        criterion: What is to be minimised.
        envelope: What is to be kept to.
        clearance: Parts to be kept apart; None: nothing is kept from hitting anything.
        speed: Rms rate that every joint should reach, as a share of `Envelope.pace`, so that friction shows.
        per_period: Samples per period of the highest harmonic while optimising.
    """

    model: Model
    series: Series
    columns: ExcitationColumns
    criterion: Criterion
    envelope: Envelope
    clearance: Clearance | None = None
    speed: float = 0.0
    per_period: int = 12

    @cached_property
    def step(self) -> float:
        """Interval of the optimisation's grid, s."""
        return self.series.seconds / (self.per_period * self.series.harmonics)

    @cached_property
    def coarse(self) -> tuple[Array, Array]:
        """Times (T,), the intervals' midpoints, and basis (3, T, k) of the optimisation's grid."""
        t = self.step * (np.arange(self.per_period * self.series.harmonics) + 0.5)
        return t, self.series.basis(t) @ self.series.rest

    @cached_property
    def dense(self) -> tuple[Array, Array]:
        """The same of the grid on which the limits are checked, both ends and 240 samples per period included."""
        t = np.linspace(0.0, self.series.seconds, 240 * self.series.harmonics + 1)
        return t, self.series.basis(t) @ self.series.rest

    def motion(self, x: Array, grid: tuple[Array, Array]) -> Motion:
        """The motion of x on a grid."""
        states = grid[1] @ x.reshape(-1, self.model.rig.n)
        states.flags.writeable = False  # spares `Motion` its copies
        return Motion(grid[0], *states)

    def evaluate(self, x: Array) -> tuple[float, Array]:
        """The objective on the coarse grid, and its gradient: through the columns' factors to q, v, a, and to x."""
        motion = self.motion(x, self.coarse)
        seen = self.columns.scale_rows(motion, compute_direction(motion.v, motion.a, self.step))
        lack, too_slow = self.compute_rate_deficit(motion)
        slopes = self.columns.compute_gradient(motion, self.step, *self.criterion.factors(seen))
        slopes[1] += 100 * too_slow  # the criteria are logarithms
        gradient = np.einsum("ctk,cti->ki", self.coarse[1], slopes).ravel()
        return self.criterion.value(seen) + 100 * lack, gradient

    def compute_rate_deficit(self, motion: Motion) -> tuple[float, Array]:
        """``sum_j max(0, 1 - rms(v_j)/(speed pace_j))^2``, and its derivative to the rates, (N, n)."""
        wished = self.speed * self.envelope.pace
        rms = np.sqrt(np.mean(motion.v**2, axis=0))
        if (rms >= wished).all():
            return 0.0, np.zeros_like(motion.v)
        lack = np.maximum(1 - rms / wished, 0.0)
        return float(lack @ lack), -2 * lack / (wished * rms * len(motion)) * motion.v

    @cached_property
    def driven(self) -> Array:
        """Joints whose torque can come near its limit while the other limits hold, (n); the others need no watching.

        Near is four fifths, as the states that are looked at are not all there are; the dense grid sees all joints.
        """
        near = (
            self.envelope.compute_torque_shares(self.model, self.envelope.spread()).max(axis=(0, 1))
            > 0.8
        )
        return np.isfinite(self.envelope.torque) & (
            near | (not np.isfinite(self.envelope.kinematic).all())
        )

    def compute_room(self, x: Array) -> Array:
        """What is left of every limit at every coarse sample, as a share; all >= 0 if the limits hold."""
        room, slopes = self.kinematic
        parts: list[Array] = [room + slopes @ x]
        motion = self.motion(x, self.coarse)
        if self.driven.any():
            parts.append(
                1
                - self.envelope.compute_torque_shares(self.model, motion)[:, :, self.driven].ravel()
            )
        if self.apart is not None:
            parts.append(self.apart.compute_room(motion.q).ravel())
        return np.concatenate(parts)

    def differentiate_room(self, x: Array) -> Array:
        """Exact Jacobian of `compute_room`, (rows, len(x))."""
        parts = [self.kinematic[1]]
        motion = self.motion(x, self.coarse)
        if self.driven.any():
            slopes = self.envelope.differentiate_torque_shares(self.model, motion)[
                :, :, :, self.driven
            ]
            parts.append(-np.einsum("sctji,ctk->stjki", slopes, self.coarse[1]).reshape(-1, len(x)))
        if self.apart is not None:
            nearing = self.apart.differentiate_room(motion.q)
            parts.append(np.einsum("tpi,tk->tpki", nearing, self.coarse[1][0]).reshape(-1, len(x)))
        return np.vstack(parts)

    @cached_property
    def apart(self) -> Clearance | None:
        """The clearance, if there are pairs to be watched."""
        return self.clearance if self.clearance is not None and self.clearance.watched else None

    @cached_property
    def kinematic(self) -> tuple[Array, Array]:
        """What the kinematic limits leave of x = 0, and its Jacobian: the basis over the limit, with either sign."""
        limits = self.envelope.kinematic
        n = self.model.rig.n
        stated = np.isfinite(limits)
        slopes = np.einsum("ctk,ji,cj->cjtki", self.coarse[1], np.eye(n), 1 / limits)[
            stated
        ].reshape(-1, n * self.series.rest.shape[1])
        still = self.motion(np.zeros(slopes.shape[1]), self.coarse)
        used = np.swapaxes(self.envelope.compute_kinematic_shares(still), 1, 2)[stated].ravel()
        return np.concatenate([1 - used, 1 + used]), np.vstack([-slopes, slopes])

    def is_within_limits(self, x: Array, grid: tuple[Array, Array]) -> bool:
        """Whether every limit holds on a grid."""
        motion = self.motion(x, grid)
        clear = self.apart is None or self.apart.compute_room(motion.q).min() >= 0
        return bool(clear and self.envelope.find_largest_shares(self.model, motion).max() <= 1)

    def scale(self, x: Array, factor: float | Array) -> Array:
        """X with its amplitudes times `factor` (one, or one per joint), about the same middle."""
        coefficients = self.coefficients(x)
        coefficients[1:] *= factor
        return (self.series.rest.T @ coefficients).ravel()

    def coefficients(self, x: Array) -> Array:
        """The series' coefficients (2 L + 1, n) of x."""
        return self.series.rest @ x.reshape(-1, self.model.rig.n)

    def repair(self, x: Array, rough: bool = False) -> Array | None:
        """X with its amplitudes scaled down until every limit holds on the dense grid; None if no motion is left.

        Angle, rate and acceleration by joint, which is exact; then the torque and the distances for all joints
        together, by bisection: if `rough`, on the coarse grid, which is enough for a start.
        """
        grid = self.coarse if rough else self.dense
        pose = self.coefficients(x)[0]
        middle = (pose - self.envelope.centre) / self.envelope.half
        if not np.abs(middle).max() < 1 or not self.is_pose_possible(pose):
            return None
        x = self.scale(x, np.minimum(self.find_widest_scale(x, middle), 1.0))
        if self.is_within_limits(x, grid):
            return x
        low, high = 0.0, 1.0
        for _ in range(14):  # to a share of 6e-5
            factor = (low + high) / 2
            low, high = (
                (factor, high)
                if self.is_within_limits(self.scale(x, factor), grid)
                else (low, factor)
            )
        return self.scale(x, low) if low > 0 else None

    def draw_start(self, rng: np.random.Generator) -> Array:
        """A random motion within the limits on the coarse grid, about a pose that is possible.

        Raises:
            UsageError: No such pose was found.
        """
        for _ in range(200):
            coefficients = self.coefficients(
                rng.standard_normal(self.series.rest.shape[1] * self.model.rig.n)
            )
            middle = rng.uniform(-0.5, 0.5, self.model.rig.n)
            coefficients[0] = self.envelope.centre + middle * self.envelope.half
            if not self.is_pose_possible(coefficients[0]):
                continue
            x = (self.series.rest.T @ coefficients).ravel()
            repaired = self.repair(self.scale(x, self.find_widest_scale(x, middle)), rough=True)
            if repaired is not None:
                return repaired
        raise self.explain_infeasibility()

    def find_widest_scale(self, x: Array, middle: Array) -> Array:
        """Factor per joint that brings x to the first of its kinematic limits, its middle off the centre, (n,)."""
        used = np.swapaxes(self.envelope.compute_kinematic_shares(self.motion(x, self.dense)), 0, 1)
        up = find_crest(used)
        down = find_crest(-used)
        peaks = [
            (up[0] - middle) / (1 - middle),
            (down[0] + middle) / (1 + middle),
            *up[1:],
            *down[1:],
        ]
        return (1 - 1e-9) / np.maximum.reduce(peaks)  # rounding cannot carry it over

    def is_pose_possible(self, pose: Array) -> bool:
        """Whether the motors can hold the rig in a pose, rad, and no parts are too near each other there."""
        return bool(
            self.compute_holding_shares(pose).max() <= 1
            and (self.apart is None or self.apart.compute_room(pose[None]).min() > 0)
        )

    def compute_holding_shares(self, pose: Array) -> Array:
        """Share of each torque limit that standing still in a pose (rad) takes, with dry friction against it, (n,)."""
        still = Motion(np.zeros(1), pose[None], np.zeros((1, len(pose))), np.zeros((1, len(pose))))
        return self.envelope.compute_torque_shares(self.model, still).max(axis=(0, 1))

    def explain_infeasibility(self) -> UsageError:
        """The error that says which joint cannot be held still, or what is in the way."""
        rig = self.model.rig
        still = self.compute_holding_shares(self.envelope.centre)
        if self.apart is not None and still.max() <= 1:
            gap = self.apart.find_smallest_gap(self.envelope.centre[None])
            between, distance = (gap.between, gap.distance) if gap else (("", ""), 0.0)
            what = f"no pose was found in which all parts keep {self.apart.required:g} m from each other"
            what += f": at mid-range {' and '.join(between)} are {distance:.3g} m apart"
            return UsageError(
                f"rig {rig.name}",
                what,
                "narrow its limits to where nothing hits, or ask for less clearance",
            )
        worst = int(np.argmax(still))
        need = still[worst] * self.envelope.torque[worst]
        have = self.envelope.torque[worst]
        return UsageError(
            f"rig {rig.name}: joint '{rig.joints[worst]}'",
            f"no pose was found that the motors can hold: mid-range takes {need:.3g} N m of {have:.3g} allowed",
            "balance the payload, or raise its torque limit",
        )
