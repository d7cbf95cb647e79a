"""The regression of logs, block by block: the same filter on every column and on the torque."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import gcd
from typing import NamedTuple, overload

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d
from tqdm import tqdm

from gimbal_pin.dynamics.model import find_rotors
from gimbal_pin.dynamics.reduction import Reduction, list_units
from gimbal_pin.dynamics.regressor import (
    compute_gravity,
    compute_inertia_regressor,
    compute_regressor,
    compute_rnea,
    name_columns,
)
from gimbal_pin.effects import Effect, Sample, Term
from gimbal_pin.errors import UsageError
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression.samples import (
    Filtering,
    Flags,
    Samples,
    Segment,
    SelectiveFilter,
    compute_decimation,
    compute_row_step,
    compute_settling_time,
    design_row_filter,
    filter_rows,
    find_moving_base,
    smooth_samples,
    split_segments,
)
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

STANDSTILL_DEVIATIONS = 2.0
"""A rate under this many of its own standard deviations does not tell its sign: at it one in 44 is wrong."""
MASK_TAPER = 0.1
"""Width over which the mask around a standstill opens, in periods of the cutoff. At half a period the mask takes what
shows inertia best, the turns: on real logs of slow swings 85 % of the samples, for a model three times worse."""
SMOOTHER_MEMORY = 0.5
"""Reach of the smoother, in periods of its cutoff."""
DIRECTION_MEMORY = 0.2
"""The same of the direction's own low-pass."""
CHUNK_SAMPLES = 4096
"""Decimated samples whose columns are held at once."""


INERTIA_SAMPLES = 50
"""Poses over which a joint's inertia is averaged: more take longer and change the mean little."""


def find_standstill(channels: Samples, filtering: Filtering) -> Flags:
    """Samples at which the smoothed rate has no certain sign, or that were not measured, (m, n).

    It is under some of its own standard deviations, or changes its sign; what fills a hole is carried by the smoother
    to its neighbours, and a turn by the slower low-pass where the direction has one.
    """
    still = find_slow_samples(channels)
    if filtering.direction is not None:
        reach = DIRECTION_MEMORY / (filtering.cutoff * filtering.direction)
        still = dilate_flags(still, round(reach / (channels.t[1] - channels.t[0])))
    if channels.lost is None:
        return still
    return still | dilate_flags(channels.lost[:, None], count_smoother_memory(channels, filtering))


def find_slow_samples(channels: Samples, sure: float = STANDSTILL_DEVIATIONS) -> Flags:
    """Whether the rate is under so many deviations, or changes its sign, or was not measured, (m, n)."""
    still = np.abs(channels.slide) < sure * channels.rate_std
    still[1:] |= channels.slide[1:] * channels.slide[:-1] < 0
    if channels.lost is not None:
        still |= channels.lost[:, None]
    return np.asarray(still)


def count_smoother_memory(channels: Samples, filtering: Filtering) -> int:
    """Samples that the smoother reaches to either side."""
    return int(
        np.ceil(
            SMOOTHER_MEMORY
            / (filtering.cutoff * filtering.smoothing * (channels.t[1] - channels.t[0]))
        )
    )


def compute_direction(v: Array, a: Array, dt: float) -> Array:
    """``∫ sign(v + a s) ds / dt`` over a sample, s in ±dt/2: the mean direction while it lasts, (m, n), in [-1, 1].

    What a coarse grid sees of the sign: exact where the rate is straight over the interval, and differentiable. The
    sign itself would put every turn on a sample: up to half an interval of twice the dry friction too much. A rate
    under 1e-9 rad/s that does not change is rounding, and no direction.
    """
    return np.minimum(np.maximum(v / np.maximum(np.abs(a) * (dt / 2), 1e-9), -1.0), 1.0)


def build_mask(still: Flags, taper: int) -> Array:
    """Weight 0 at standstill, rising smoothly to 1 over `taper` samples, (m, n).

    A mask with sharp edges would fold the noise above the cutoff into the band that the filter keeps.
    """
    half = max(taper // 2, 1)
    opened = 1.0 - dilate_flags(still, 2 * half)
    for _ in range(2):
        opened = uniform_filter1d(opened, 2 * (half // 2) + 1, axis=0, mode="nearest")
    return np.where(still, 0.0, np.clip(opened, 0.0, 1.0))


def dilate_flags(still: Flags, reach: int) -> Flags:
    """Whether a sample is within `reach` samples of one of `still`, (m, n)."""
    return uniform_filter1d(still.astype(float), 2 * reach + 1, axis=0, mode="constant") > 1e-9


def find_base_columns(rig: Rig, reduction: Reduction) -> Array:
    """Places in `Rig.phi` of the reduction's independent columns."""
    names, places = name_columns(rig)
    index = dict(zip(names, places))
    return np.array([index[reduction.names[j]] for j in reduction.independent])


def compute_motorless_correction(
    rig: Rig, reduction: Reduction, joint: int, q: Array, left: Array
) -> Array:
    """Return what is added to the columns of the rows ``0 = A x`` of a joint without a motor, (m, k).

    As they stand, x = 0 fits them best, and noise of the acceleration draws x there. What is wrong with them is an
    acceleration, ``A x / c x`` with the joint's inertia ``c x``: linearised at the URDF's x₀,
    ``(A - A x₀ c / c x₀) x = -A x₀``.

    Args:
        rig: The rig.
        reduction: Its base parameters.
        joint: The joint.
        q: Angles, rad, (any, n).
        left: ``A x₀``, N m, (m,).
    """
    places = find_base_columns(rig, reduction)
    poses = q[:: max(1, len(q) // INERTIA_SAMPLES)]
    inertia = compute_inertia_regressor(rig, poses, joint, places)[:, joint].mean(axis=0)
    urdf = reduction.mixing @ rig.phi[name_columns(rig)[1]]
    return np.asarray(np.outer(-left, inertia / (inertia @ urdf)))


def map_phi_to_base(rig: Rig, reduction: Reduction) -> Array:
    """Base parameters per entry of `Rig.phi`, (b, 10 n)."""
    out = np.zeros((len(reduction.independent), 10 * rig.n))
    out[:, name_columns(rig)[1]] = reduction.mixing
    return out


def find_camera_body(rig: Rig) -> int:
    """Return the body (from 0) that carries the camera."""
    link = rig.payload_link or rig.camera_frame
    return (
        int(rig.model.frames[rig.model.getFrameId(link, pin.FrameType.BODY)].parentJoint or rig.n)
        - 1
    )


class Block(NamedTuple):
    """Design of one segment of one trajectory.

    Attributes:
        t: Time, s, (m,).
        A: Torque per parameter, filtered, (m, n, k).
        b: Torque less what is known of it, filtered, N m, (m, n).
        q: Angles, rad, (m, n).
        v: Rates, rad/s, (m, n).
        share: How much of a row's samples were not masked out, in [0, 1], (m, n).
        slope: The measured torque's derivative, filtered as it is, N m/s, (m, n).
        known: Torque that is not fitted, filtered, N m, (m, n): that of the stated rotors among it.
    """

    t: Array
    A: Array
    b: Array
    q: Array
    v: Array
    share: Array
    slope: Array
    known: Array

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)


class RowFilter(NamedTuple):
    """How samples become rows: decimated, masked, filtered, and of these every so many.

    Attributes:
        few: Samples that are kept before the filter.
        rows: Which of these become rows.
        moving: The mask at them, (m, n).
        low_pass: The filter.
    """

    few: slice
    rows: slice
    moving: Array
    low_pass: SelectiveFilter

    def filter_torque(self, tau: Array) -> Array:
        """Mask and filter a decimated torque, (m, n), and return its rows."""
        return self.low_pass(tau * self.moving, self.rows).copy()


@dataclass(frozen=True, eq=False)
class Design:
    """The regression ``A theta = b`` of logs against base parameters and effects; iterating recomputes the blocks.

    Attributes:
        rig: The rig.
        reduction: Its base parameters.
        effects: Effects whose coefficients follow the base parameters in theta.
        logs: Trajectories, never joined.
        filtering: Filter and alignment.
        masked: Leave out what dry friction makes unpredictable: a joint at rest takes any torque within its dry
            friction without moving, so near standstill its motion does not tell the torque. False: every sample, with
            the sign of the rate as it is, for those who want to see all.
    """

    rig: Rig
    reduction: Reduction
    effects: tuple[Effect, ...]
    logs: tuple[Log, ...]
    filtering: Filtering
    masked: bool = True

    __repr__ = brief

    def __post_init__(self) -> None:
        """Take those rotors that are fitted out of the rig."""
        object.__setattr__(self, "rig", self.rig.with_rotors_apart(find_rotors(self.effects)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta: base parameters, then ``joint.coefficient``."""
        return self.reduction.base_names + tuple(
            f"{effect.joint}.{coefficient.name}"
            for effect in self.effects
            for coefficient in effect.coefficients
        )

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of theta."""
        leading = [self.reduction.names[j].rsplit(".", 1)[1] for j in self.reduction.independent]
        return list_units(leading) + tuple(
            self.rig.in_units(effect.joint, c.unit)
            for effect in self.effects
            for c in effect.coefficients
        )

    @property
    def mixing(self) -> Array:
        """Base parameters per entry of `Rig.phi`, (b, 10 n)."""
        return map_phi_to_base(self.rig, self.reduction)

    def to_bodies(self, beta: Array) -> Array:
        """Bodies of these base parameters, (10 n,): the independent columns take the change, others stay as given.

        No other split is more right, as no torque can tell them apart.
        """
        phi = self.rig.phi.copy()
        phi[find_base_columns(self.rig, self.reduction)] += beta - self.mixing @ phi
        return phi

    def to_terms(self, theta: Array) -> tuple[Term, ...]:
        """Return the effects with their coefficients out of theta, (k,)."""
        out = []
        at = len(self.reduction.independent)
        for effect in self.effects:
            size = len(effect.coefficients)
            out.append(Term(effect, tuple(float(x) for x in theta[at : at + size])))
            at += size
        return tuple(out)

    def __iter__(self) -> Iterator[Block]:
        """Yield the blocks of every trajectory in time order."""
        return self.iterate_blocks()

    def iterate_blocks(self, read: Callable[[Segment], Segment] | None = None) -> Iterator[Block]:
        """Yield the same with columns of another reading of each segment's motion, see `build_blocks`."""
        for log in self.logs:
            carrier = find_moving_base(self.rig, log)
            for segment in split_segments(log, self.filtering.cutoff):
                yield from self.build_blocks(
                    segment, carrier, None if read is None else read(segment)
                )

    def build_blocks(
        self, segment: Segment, carrier: str | None = None, motion: Segment | None = None
    ) -> Iterator[Block]:
        """Yield one segment's blocks; each is computed with enough samples around it for the filters to settle.

        Args:
            segment: The segment.
            carrier: The link whose IMU says how the base moves, see `find_moving_base`.
            motion: Another reading of the same motion, on the same grid, of which the columns are; torque and mask
                stay those of the segment. None: the segment's own.
        """
        pad = int(np.ceil(compute_settling_time(self.filtering) / segment.dt))
        thin = compute_decimation(self.filtering, segment.dt)
        step = compute_row_step(self.filtering, segment.dt)
        chunk = thin * CHUNK_SAMPLES
        for begin in range(pad, segment.length - pad, chunk):
            end = min(begin + chunk, segment.length - pad)
            first = begin - pad
            last = end + pad
            channels = smooth_samples(segment, self.filtering, first, last, carrier)
            keep = slice(pad + -begin % step, pad + end - begin, step)
            moved = (
                None
                if motion is None
                else smooth_samples(motion, self.filtering, first, last, carrier)
            )
            if keep.start < keep.stop:
                yield self.build_block(channels, keep, 1.0 / segment.dt, moved)

    def build_row_filter(self, channels: Samples, keep: slice, rate: float) -> RowFilter:
        """Return how the channels, `rate` samples per second, become rows at the samples `keep`.

        A joint's equation holds at every sample, so it may be multiplied by any mask before the filter: the samples
        near standstill, where the direction of dry friction is unknown, are masked out, and the equation stays exact.
        """
        begin, end, step = keep.indices(len(channels.t))
        thin = gcd(step, compute_decimation(self.filtering, 1.0 / rate))
        few = slice(begin % thin, None, thin)
        rows = slice(begin // thin, (end - 1 - begin % thin) // thin + 1, step // thin)
        moving: Array = np.ones(channels.v.shape)
        if self.masked:
            still = find_standstill(channels, self.filtering)
            moving = build_mask(still, round(MASK_TAPER / self.filtering.cutoff * rate))
        return RowFilter(few, rows, moving[few], design_row_filter(self.filtering, rate / thin))

    def build_block(
        self, channels: Samples, keep: slice, rate: float, moved: Samples | None = None
    ) -> Block:
        """Return the rows at the samples `keep` of the channels, see `build_row_filter`.

        What is smooth is decimated, see `compute_decimation`, before the bodies' columns are computed and filtered.

        Args:
            channels: The samples.
            keep: Which of them become rows.
            rate: Samples per second.
            moved: Another reading of the same motion, of which the columns are; None: these.
        """
        way = self.build_row_filter(channels, keep, rate)
        moved = channels if moved is None else moved
        # The torque has been smoothed with the channels; columns that jump where a joint turns must be, too.
        sections = signals.lowpass(self.filtering.cutoff * self.filtering.smoothing, rate)
        smoother = partial(filter_rows, sections=sections)
        slope = way.filter_torque(signals.differentiate(channels.tau, 1.0 / rate)[way.few])
        jumping = _filter_columns(self.compute_effect_columns(moved), smoother, way.few)
        channels = channels.select(way.few)
        moved = moved.select(way.few)
        rigid = self.compute_rigid_columns(moved)
        known = self.compute_known_torque(moved, rigid)
        A = _filter_columns(
            np.concatenate([rigid, jumping], axis=2), way.low_pass, way.rows, way.moving
        )
        share = np.clip(way.low_pass(way.moving, way.rows), 0.0, 1.0)
        # Copies: a view would keep the whole chunk alive behind the few rows that it shows.
        t, q, v = (x[way.rows].copy() for x in (channels.t, channels.q, channels.v))
        rest, given = (way.filter_torque(x) for x in (channels.tau - known, known))
        urdf = self.mixing @ self.rig.phi
        bodies = slice(len(urdf))
        for j in self.undriven:
            left = A[:, j, bodies] @ urdf
            A[:, j, bodies] += compute_motorless_correction(
                self.rig, self.reduction, j, channels.q, left
            )
            rest[:, j] -= left
        return Block(t, A, rest, q, v, share, slope, given)

    @property
    def undriven(self) -> tuple[int, ...]:
        """Numbers of the joints without a motor: their torque is zero all along, in every log."""
        logs = [log.tau for log in self.logs if log.tau is not None]
        driven = np.any([tau.any(axis=0) for tau in logs], axis=0)
        return tuple(np.flatnonzero(~driven).tolist()) if logs and driven.any() else ()

    def compute_rigid_columns(self, channels: Samples) -> Array:
        """Base columns of the regressor, (m, n, b)."""
        places = find_base_columns(self.rig, self.reduction)
        return compute_regressor(
            self.rig, channels.q, channels.v, channels.a, channels.platform, places
        )

    def compute_known_torque(self, channels: Samples, rigid: Array) -> Array:
        """``rnea - Y_base beta`` of the rig as given, N m, (m, n): what its base parameters do not hold.

        It is the torque of the stated rotors that are not fitted, ``I_a a``. Where the base moves in a way that shows
        parameters which are not among the base parameters, these stay as given, too.
        """
        if channels.platform is None or self.reduction.base == "rotating":
            return channels.a * self.rig.armature
        whole = compute_rnea(self.rig, channels.q, channels.v, channels.a, channels.platform)
        return whole - rigid @ (self.reduction.mixing @ self.rig.phi[name_columns(self.rig)[1]])

    def compute_effect_columns(self, channels: Samples) -> Array:
        """Columns of the effects, (m, n, e)."""
        return compute_effect_columns(self.rig, self.effects, channels, np.sign(channels.slide))


def compute_effect_columns(
    rig: Rig, effects: Sequence[Effect], channels: Samples, slide: Array, pull: Array | None = None
) -> Array:
    """Torque at each joint per coefficient of the effects, (m, n, e); of coupled motors ``gᵀ basis(g q, g v, g a)``.

    Args:
        rig: The rig.
        effects: The effects.
        channels: The states.
        slide: Direction of sliding in [-1, 1], (m, n).
        pull: Torque that the rig asks for at rest, N m, (m, n); None: as the states have it.
    """
    out = np.zeros((*channels.q.shape, sum(len(effect.coefficients) for effect in effects)))
    if pull is None:
        asked = any(effect.weighed for effect in effects)
        pull = (
            compute_gravity(rig, channels.q, channels.platform)
            if asked
            else np.zeros_like(channels.q)
        )
    column = 0
    for effect in effects:
        if effect.coupling:
            g = rig.build_motor_row(effect.joint)
            q, v, a, rate, tau = (
                x @ g for x in (channels.q, channels.v, channels.a, channels.slide, channels.tau)
            )
            for basis in effect.basis(Sample(channels.t, q, v, a, np.sign(rate), tau)):
                out[:, :, column] = np.outer(basis, g)
                column += 1
            continue
        j = rig.joint_index(effect.joint)
        own = (x[:, j] for x in (channels.q, channels.v, channels.a, slide, channels.tau))
        for basis in effect.basis(Sample(channels.t, *own)._replace(weight=pull[:, j])):
            out[:, j, column] = basis
            column += 1
    return out


def _filter_columns(
    columns: Array, low_pass: SelectiveFilter, keep: slice, mask: Array | None = None
) -> Array:
    """Run a filter over columns, (m, n, k), and return the samples `keep`, (r, n, k).

    Only those columns that a joint feels: of a long chain's most feel hardly half.

    `mask`: weight of each sample, (m, n).
    """
    out = np.zeros((len(range(*keep.indices(len(columns)))), *columns.shape[1:]))
    joints, places = np.nonzero(columns.any(axis=0))
    felt = columns[:, joints, places]
    out[:, joints, places] = low_pass(felt if mask is None else felt * mask[:, joints], keep)
    return out


@dataclass(frozen=True, eq=False)
class DesignBlocks(Sequence[Block]):
    """Blocks, computed once, and the design that they are of: for estimators that must know what the columns stand for.

    Attributes:
        design: What they were computed from.
        blocks: The blocks.
    """

    design: Design
    blocks: tuple[Block, ...]

    @overload
    def __getitem__(self, at: int) -> Block: ...

    @overload
    def __getitem__(self, at: slice) -> tuple[Block, ...]: ...

    def __getitem__(self, at: int | slice) -> Block | tuple[Block, ...]:
        """Return a block, or some."""
        return self.blocks[at]

    def __len__(self) -> int:
        """Number of blocks."""
        return len(self.blocks)


def get_design(blocks: Sequence[Block]) -> Design:
    """Return the design that blocks are of; `UsageError` where they are mixed from several."""
    if not isinstance(blocks, DesignBlocks):
        what = "needs to know the rig behind its rows, and these are mixed from several payloads'"
        raise UsageError(
            "this estimator", what, "use weighted, ols or robust, or identify each payload alone"
        )
    return blocks.design


def compute_blocks(design: Design) -> DesignBlocks:
    """Compute every block once and keep them: after decimation even a million samples are some 20 MB."""
    return DesignBlocks(
        design, tuple(tqdm(design, "rows", unit="block", disable=None, leave=False, delay=2))
    )
