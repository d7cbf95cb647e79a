"""A quick regression for the audit, and what a fault costs in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gimbal_pin.dynamics.model import friction_effects
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import BaseMotion
from gimbal_pin.regression import (
    STANDSTILL_DEVIATIONS,
    Block,
    Design,
    Filtering,
    Flags,
    Samples,
    Segment,
    build_mask,
    classify_base_motion,
    compute_residuals,
    dilate_flags,
    find_moving_base,
    fit_weighted,
    smooth_samples,
    split_segments,
)
from gimbal_pin.rig.rig import Rig

MATERIAL = 0.01
"""What moves the torque by less than this share of its rms does not matter."""
SIGN_BAND = 2.5
"""Low-pass on the rate whose sign dry friction takes, in multiples of the cutoff."""
TRUNCATE = 3.0
"""Reach of the Gaussian, in its deviations."""
REST = 1e-3
"""A rate under this share of its rms is none, even in a log without noise."""
REACH, TAPER = 0.02, 0.03
"""Width that is masked out around a standstill, and over which the mask opens, s."""


class Piece(NamedTuple):
    """A stretch of a log, thinned, with the mask on every column.

    Attributes:
        t: Time, s, (m,).
        A: Torque per base parameter and friction coefficient, (m, n, k).
        tau: Torque without the mask, N m, (m, n).
        q: Angle, rad, (m, n).
        v: Rate, rad/s, (m, n).
        open: The mask, in [0, 1], (m, n).
        dt: Interval, s.
    """

    t: Array
    A: Array
    tau: Array
    q: Array
    v: Array
    open: Array
    dt: float

    @property
    def b(self) -> Array:
        """The masked torque, N m, (m, n)."""
        return self.tau * self.open


class Probe(NamedTuple):
    """The pieces of a log, and the names and units of their columns."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    pieces: tuple[Piece, ...]


def probe(
    rig: Rig,
    log: Log,
    filtering: Filtering,
    like: Probe | None = None,
    twin: int | None = None,
    base: BaseMotion | None = None,
) -> Probe:
    """Build the columns of a log.

    Args:
        rig: The rig.
        log: The log.
        filtering: Bandwidth of the smoother, alignment of the torque.
        like: Take times, masks and torques from this probe of the same log.
        twin: 0 or 1: from the even or the odd samples of angle and rate only; two readings of one motion whose white
            noise is independent.
        base: How the base moves; None: what this log says, of which a part may say less than the whole.
    """
    rows = Design(
        rig, reduce(rig, base=base or classify_base_motion(rig, log)), friction_effects(rig.joints), (log,), filtering
    )
    pieces: list[Piece] = []
    for stretch in split_segments(log, filtering.cutoff):
        pad = int(np.ceil(signals.settling(filtering.cutoff * filtering.smoothing) / stretch.dt))
        if stretch.length > 4 * pad:
            model = like.pieces[len(pieces)] if like is not None else None
            pieces.append(piece(rows, stretch if twin is None else halved(stretch, twin), pad, model))
    return Probe(rows.names, rows.units, tuple(pieces))


def halved(stretch: Segment, first: int) -> Segment:
    """Return a stretch's grid over every second sample of its log."""
    log = stretch.log.part(slice(stretch.rows.start + first, stretch.rows.stop, 2))
    return stretch._replace(log=log, rows=slice(0, len(log)))


def piece(rows: Design, stretch: Segment, pad: int, like: Piece | None) -> Piece:
    """Return one stretch's columns at four times the smoother's bandwidth, without its `pad` samples at the ends."""
    full = smooth_samples(stretch, rows.filtering, 0, stretch.length, find_moving_base(rows.rig, stretch.log))
    band = rows.filtering.cutoff * rows.filtering.smoothing
    keep = slice(pad, stretch.length - pad, max(1, int(1.0 / (4.0 * band * stretch.dt))))
    slow, still = sliding(full, stretch, SIGN_BAND * rows.filtering.cutoff)
    ch = full.select(keep)
    moving = like.open if like is not None else build_mask(still, round(TAPER / stretch.dt))[keep]
    tau = like.tau if like is not None else ch.tau - rows.compute_stated_torque(ch)
    A = np.concatenate([rows.compute_rigid_columns(ch), rows.compute_effect_columns(ch._replace(v=slow[keep]))], axis=2)
    return Piece(ch.t, A * moving[:, :, None], tau, ch.q, ch.v, moving, stretch.dt * keep.step)


def sliding(channels: Samples, stretch: Segment, band: float) -> tuple[Array, Flags]:
    """Return the rate at a low bandwidth, (m, n), and where it does not tell its sign, (m, n).

    The sign that dry friction takes is that of the slow motion: a rate full of vibration would leave no sample.
    """
    sections = signals.lowpass(band, 1.0 / stretch.dt)
    slow = signals.zero_phase(channels.v, sections)
    noise = signals.noise_std(stretch.log.q[stretch.rows]) * signals.noise_gain(sections, 1.0 / stretch.dt, 1)
    still = np.abs(slow) < np.maximum(STANDSTILL_DEVIATIONS * noise, REST * np.sqrt(np.mean(slow**2, axis=0)))
    still[1:] |= slow[1:] * slow[:-1] < 0
    if channels.lost is not None:
        still |= channels.lost[:, None]
    return slow, dilate_flags(still, max(1, round(REACH / stretch.dt)))


def rows_at(made: Probe, cutoff: float) -> tuple[Block, ...]:
    """Return the rows at a cutoff, Hz, one every half period; a piece shorter than the filter gives none."""
    blocks = []
    deviation = np.sqrt(np.log(2.0) / 2.0) / (np.pi * cutoff)  # of the Gaussian whose response is one half there, s
    for part in made.pieces:
        edge = int(np.ceil(TRUNCATE * deviation / part.dt))
        keep = slice(edge, len(part.t) - edge, max(1, round(1.0 / (2.0 * cutoff * part.dt))))
        if keep.start < keep.stop:
            wide = deviation / part.dt
            A = np.zeros((len(range(*keep.indices(len(part.t)))), *part.A.shape[1:]))
            present = np.any(part.A != 0.0, axis=0)
            A[:, present] = blurred(part.A[:, present], wide)[keep]
            b, share = (blurred(x, wide)[keep] for x in (part.b, part.open))
            blocks.append(Block(part.t[keep], A, b, part.q[keep], part.v[keep], share))
    return tuple(blocks)


def blurred(signal: Array, deviation: float) -> Array:
    """Gaussian low-pass along the first axis, of so many samples' deviation, reaching `TRUNCATE` of them."""
    return np.asarray(gaussian_filter1d(signal, deviation, axis=0, mode="nearest", truncate=TRUNCATE))


def spoils_torque(rig: Rig, log: Log, mended: Log, filtering: Filtering) -> bool:
    """Whether a fault matters: a log's residual differs from its mended version's, under the model of the latter.

    By more than that model leaves of the mended log's torque anyway, and than `MATERIAL` of it, rms, at any joint. A
    part of the log that only one of the two has makes no difference. Where the mended log is too short to be fitted,
    or where only one of the two says that the base moves, any fault matters.
    """
    good, bad = (rows_at(probe(rig, one, filtering), filtering.cutoff) for one in (mended, log))
    if not good or sum(block.b.size for block in good) < 3 * good[0].A.shape[2]:
        return True
    if bad and bad[0].A.shape[2] != good[0].A.shape[2]:
        return True
    theta = fit_weighted(good).theta
    left = np.concatenate([compute_residuals(block, theta) for block in good])
    torque = np.concatenate([block.b for block in good])
    floor, size = (np.sqrt(np.mean(x**2, axis=0)) for x in (left, torque))
    error = np.sqrt(np.mean(difference(good, left, bad, theta, filtering.cutoff) ** 2, axis=0))
    return bool(np.any(error > np.maximum(np.maximum(floor, MATERIAL * size), 1e-300)))


def difference(good: Sequence[Block], left: Array, bad: Sequence[Block], theta: Array, cutoff: float) -> Array:
    """Return the bad rows' residual less the good ones', at those times of the good rows near which there are both."""
    if not bad:
        return np.zeros((1, left.shape[1]))
    at, t = (np.concatenate([block.t for block in blocks]) for blocks in (good, bad))
    other = np.concatenate([compute_residuals(block, theta) for block in bad])
    after = np.clip(np.searchsorted(t, at), 1, max(len(t) - 1, 1)) if len(t) > 1 else np.zeros(len(at), int)
    near = np.minimum(np.abs(at - t[after]), np.abs(at - t[after - 1])) < 0.5 / cutoff
    interpolated = np.stack([np.interp(at, t, column) for column in other.T], axis=1)
    return np.asarray((interpolated - left)[near]) if near.any() else np.zeros((1, left.shape[1]))
