"""The regression of logs, block by block: the same filter on every column and on the torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import gcd
from typing import NamedTuple

import numpy as np

from gimbal_pin.dynamics.reduction import Reduction, units
from gimbal_pin.dynamics.regressor import columns, regressor, rnea, weight
from gimbal_pin.effects import Effect, Sample, Term
from gimbal_pin.estimation.rows.carrier import carrying
from gimbal_pin.estimation.rows.channels import Channels, smoothed
from gimbal_pin.estimation.rows.filtering import Filtering, settling, thinning
from gimbal_pin.estimation.rows.grid import Stretch, stretches
from gimbal_pin.estimation.rows.masking import TAPER, mask, standstill
from gimbal_pin.estimation.rows.places import columns_of, over_phi
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig

CHUNK = 4096
"""Decimated samples whose columns are held at once."""


class Block(NamedTuple):
    """Rows of one stretch of one trajectory.

    Attributes:
        t: Time, s, (m,).
        A: Torque per parameter, filtered, (m, n, k).
        b: Torque, filtered, N m, (m, n).
        q: Angles, rad, (m, n).
        v: Rates, rad/s, (m, n).
        share: How much of a row's samples were not masked out, in [0, 1], (m, n).
    """

    t: Array
    A: Array
    b: Array
    q: Array
    v: Array
    share: Array


@dataclass(frozen=True, eq=False)
class Rows:
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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta: base parameters, then ``joint.coefficient``."""
        return self.reduction.base_names + tuple(
            f"{effect.joint}.{coefficient.name}" for effect in self.effects for coefficient in effect.coefficients
        )

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of theta."""
        leading = [self.reduction.names[j].rsplit(".", 1)[1] for j in self.reduction.independent]
        return units(leading) + tuple(c.unit for effect in self.effects for c in effect.coefficients)

    @property
    def mixing(self) -> Array:
        """Base parameters per entry of `Rig.phi`, (b, 10 n)."""
        return over_phi(self.rig, self.reduction)

    def phi(self, beta: Array) -> Array:
        """Bodies of these base parameters, (10 n,): the independent columns take the change, others stay as given.

        No other split is more right, as no torque can tell them apart.
        """
        phi = self.rig.phi.copy()
        phi[columns_of(self.rig, self.reduction)] += beta - self.mixing @ phi
        return phi

    def terms(self, theta: Array) -> tuple[Term, ...]:
        """Return the effects with their coefficients out of theta, (k,)."""
        out, at = [], len(self.reduction.independent)
        for effect in self.effects:
            size = len(effect.coefficients)
            out.append(Term(effect, tuple(float(x) for x in theta[at : at + size])))
            at += size
        return tuple(out)

    def __iter__(self) -> Iterator[Block]:
        """Yield the blocks of every trajectory in time order."""
        for log in self.logs:
            carrier = carrying(self.rig, log)
            for stretch in stretches(log, self.filtering.cutoff):
                yield from self.blocks(stretch, carrier)

    def blocks(self, stretch: Stretch, carrier: str | None = None) -> Iterator[Block]:
        """Yield one stretch's blocks; each is computed with enough samples around it for the filters to settle.

        Args:
            stretch: The stretch.
            carrier: The link whose IMU says how the base moves, see `carrying`.
        """
        pad = int(np.ceil(settling(self.filtering) / stretch.dt))
        thin = thinning(self.filtering, stretch.dt)
        step, chunk = thin * max(1, round(1.0 / (2 * self.filtering.cutoff * stretch.dt * thin))), thin * CHUNK
        for begin in range(pad, stretch.length - pad, chunk):
            end = min(begin + chunk, stretch.length - pad)
            first, last = begin - pad, end + pad
            channels = smoothed(stretch, self.filtering, first, last, carrier)
            keep = slice(pad + -begin % step, pad + end - begin, step)
            if keep.start < keep.stop:
                yield self.block(channels, keep, 1.0 / stretch.dt)

    def block(self, channels: Channels, keep: slice, rate: float) -> Block:
        """Return the rows at the samples `keep` of the channels.

        A joint's equation holds at every sample, so it may be multiplied by any mask before the filter: the samples
        near standstill, where the direction of dry friction is unknown, are masked out, and the equation stays exact.
        What is smooth then is decimated before the bodies' columns are computed and all is filtered, see `thinning`.
        """
        begin, end, step = keep.indices(len(channels.t))
        thin = gcd(step, thinning(self.filtering, 1.0 / rate))
        offset = begin % thin
        few, rows = slice(offset, None, thin), slice(begin // thin, (end - 1 - offset) // thin + 1, step // thin)
        still = standstill(channels, self.filtering)
        moving = mask(still, round(TAPER / self.filtering.cutoff * rate)) if self.masked else np.ones(still.shape)
        # The torque has been smoothed with the channels; columns that jump where a joint turns must be, too.
        smoother = signals.lowpass(self.filtering.cutoff * self.filtering.smoothing, rate)
        jumping = passed(self.effect_columns(channels), smoother, few)
        channels, moving = channels.every(few), moving[few]
        sections = signals.lowpass(self.filtering.cutoff, rate / thin)
        rigid = self.rigid_columns(channels)
        tau = channels.tau - self.unfitted(channels, rigid)
        A = passed(np.concatenate([rigid, jumping], axis=2), sections, rows, moving)
        b, share = (signals.zero_phase(x, sections)[rows] for x in (tau * moving, moving))
        # Copies: a view would keep the whole chunk alive behind the few rows that it shows.
        return Block(
            channels.t[rows].copy(),
            A,
            b.copy(),
            channels.q[rows].copy(),
            channels.v[rows].copy(),
            np.clip(share, 0.0, 1.0),
        )

    def rigid_columns(self, channels: Channels) -> Array:
        """Base columns of the regressor, (m, n, b)."""
        places = columns_of(self.rig, self.reduction)
        return regressor(self.rig, channels.q, channels.v, channels.a, channels.platform, places)

    def unfitted(self, channels: Channels, rigid: Array) -> Array | float:
        """``Y phi - Y_base beta`` of the rig as given, N m, (m, n): what its base parameters do not hold.

        Nothing, unless the base moves in a way that shows parameters which are not among them: these stay as given.
        """
        if channels.platform is None or self.reduction.base == "rotating":
            return 0.0
        whole = rnea(self.rig, channels.q, channels.v, channels.a, channels.platform)
        return whole - rigid @ (self.reduction.mixing @ self.rig.phi[columns(self.rig)[1]])

    def effect_columns(self, channels: Channels) -> Array:
        """Columns of the effects, (m, n, e)."""
        slide = np.sign(channels.v)
        width = sum(len(effect.coefficients) for effect in self.effects)
        out, column = np.zeros((*channels.q.shape, width)), 0
        pull = np.zeros_like(channels.q)
        if any(effect.weighed for effect in self.effects):
            pull = weight(self.rig, channels.q, channels.platform)
        for effect in self.effects:
            j = self.rig.joint_index(effect.joint)
            own = (x[:, j] for x in (channels.q, channels.v, channels.a, slide, channels.tau))
            at = Sample(channels.t, *own)._replace(weight=pull[:, j])
            for basis in effect.basis(at):
                out[:, j, column] = basis
                column += 1
        return out


def passed(columns: Array, sections: Array, keep: slice, mask: Array | None = None) -> Array:
    """Run the sections forwards and backwards over columns, (m, n, k), and return the samples `keep`, (r, n, k).

    Joint by joint, and only those columns that a joint feels: of a long chain's most feel hardly half.

    `mask`: weight of each sample, (m, n).
    """
    out = np.zeros((len(range(*keep.indices(len(columns)))), *columns.shape[1:]))
    for j in range(columns.shape[1]):
        felt = np.flatnonzero(columns[:, j].any(axis=0))
        own = columns[:, j, felt] if mask is None else columns[:, j, felt] * mask[:, [j]]
        out[:, j, felt] = signals.zero_phase(own, sections)[keep]
    return out
