"""A quick regression for the audit: columns built once at a low rate, then filtered at any cutoff.

The rows of `gimbal_pin.rows` fit a model; these only ask what a fit would say. Their low-pass is a Gaussian of compact
support with the same -6 dB point, so that a log of four seconds keeps rows at 4 Hz.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gimbal_pin import signals
from gimbal_pin.identification import units_of
from gimbal_pin.log import Array, Log
from gimbal_pin.model import friction_effects
from gimbal_pin.reduction import reduce
from gimbal_pin.regressor import regressor
from gimbal_pin.rig import Rig
from gimbal_pin.rows import (
    STANDSTILL,
    Block,
    Channels,
    Filtering,
    Flags,
    Rows,
    Stretch,
    columns_of,
    dilated,
    mask,
    smoothed,
    stretches,
)

SIGN_BAND = 2.5
"""Low-pass on the rate whose sign dry friction takes, in multiples of the cutoff."""
TRUNCATE = 3.0
"""Reach of the Gaussian, in its deviations."""
REST = 1e-3
"""A rate under this share of its rms is none, even in a log without noise."""
REACH, TAPER = 0.02, 0.03
"""Width that is masked out around a standstill, and over which the mask opens, s."""


class Piece(NamedTuple):
    """A stretch of a log, thinned, with the mask on every column and on the torque.

    Attributes:
        t: Time, s, (m,).
        A: Torque per base parameter and friction coefficient, (m, n, k).
        inertial: The part of the base columns that the acceleration makes, (m, n, b).
        b: Torque, N m, (m, n).
        v: Rate, rad/s, (m, n).
        open: The mask, in [0, 1], (m, n).
        dt: Interval, s.
    """

    t: Array
    A: Array
    inertial: Array
    b: Array
    v: Array
    open: Array
    dt: float


class Probe(NamedTuple):
    """The pieces of a log, and the names and units of their columns."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    pieces: tuple[Piece, ...]


def probe(rig: Rig, log: Log, like: Probe | None = None, twin: int | None = None) -> Probe:
    """Build the columns of a log.

    Args:
        rig: The rig.
        log: The log.
        like: Take times, masks and torques from this probe of the same log.
        twin: 0 or 1: from the even or the odd samples of angle and rate only; two readings of one motion whose white
            noise is independent.
    """
    filtering = Filtering()
    rows = Rows(rig, reduce(rig), friction_effects(rig.joints), (log,), filtering)
    pieces: list[Piece] = []
    for stretch in stretches(log, filtering.cutoff):
        pad = int(np.ceil(signals.settling(filtering.cutoff * filtering.smoothing) / stretch.dt))
        if stretch.length > 4 * pad:
            model = like.pieces[len(pieces)] if like is not None else None
            pieces.append(piece(rows, stretch if twin is None else halved(stretch, twin), pad, model))
    return Probe(rows.names, units_of(rows), tuple(pieces))


def halved(stretch: Stretch, first: int) -> Stretch:
    """Return a stretch's grid over every second sample of its log."""
    log = stretch.log.part(slice(stretch.rows.start + first, stretch.rows.stop, 2))
    return stretch._replace(log=log, rows=slice(0, len(log)))


def piece(rows: Rows, stretch: Stretch, pad: int, like: Piece | None) -> Piece:
    """Return one stretch's columns at four times the smoother's bandwidth, without its `pad` samples at the ends."""
    filtering, rig = rows.filtering, rows.rig
    full = smoothed(stretch, filtering, 0, stretch.length)
    band = filtering.cutoff * filtering.smoothing
    keep = slice(pad, stretch.length - pad, max(1, int(1.0 / (4.0 * band * stretch.dt))))
    slow, still = sliding(full, stretch, SIGN_BAND * filtering.cutoff)
    ch = full._replace(t=full.t[keep], q=full.q[keep], v=full.v[keep], a=full.a[keep], tau=full.tau[keep])
    places = columns_of(rig, rows.reduction)
    rigid, static = (regressor(rig, ch.q, ch.v, a)[:, :, places] for a in (ch.a, np.zeros_like(ch.a)))
    A = np.concatenate([rigid, rows.effect_columns(ch._replace(v=slow[keep]))], axis=2)
    dt = stretch.dt * keep.step
    moving = mask(still, round(TAPER / stretch.dt))[keep] if like is None else like.open
    torque = ch.tau * moving if like is None else like.b
    wide = moving[:, :, None]
    return Piece(ch.t, A * wide, (rigid - static) * wide, torque, ch.v, moving, dt)


def sliding(channels: Channels, stretch: Stretch, band: float) -> tuple[Array, Flags]:
    """Return the rate at a low bandwidth, (m, n), and where it does not tell its sign, (m, n).

    The sign that dry friction takes is that of the slow motion: a rate full of vibration would leave no sample.
    """
    sections = signals.lowpass(band, 1.0 / stretch.dt)
    slow = signals.zero_phase(channels.v, sections)
    noise = signals.noise_std(stretch.log.q[stretch.rows]) * signals.noise_gain(sections, 1.0 / stretch.dt, 1)
    still = np.abs(slow) < np.maximum(STANDSTILL * noise, REST * np.sqrt(np.mean(slow**2, axis=0)))
    still[1:] |= slow[1:] * slow[:-1] < 0
    return slow, dilated(still, max(1, round(REACH / stretch.dt)))


def blurred(signal: Array, cutoff: float, dt: float) -> Array:
    """Gaussian low-pass along the first axis, -6 dB at `cutoff` Hz, reaching `TRUNCATE` of its deviations."""
    return np.asarray(gaussian_filter1d(signal, deviation(cutoff) / dt, axis=0, mode="nearest", truncate=TRUNCATE))


def deviation(cutoff: float) -> float:
    """Standard deviation of the Gaussian whose response is one half at `cutoff` Hz, s."""
    return float(np.sqrt(np.log(2.0) / 2.0) / (np.pi * cutoff))


def kept(piece: Piece, cutoff: float) -> slice:
    """Samples that become rows: one every half period, none that the filter's edge reaches."""
    edge = int(np.ceil(TRUNCATE * deviation(cutoff) / piece.dt))
    return slice(edge, len(piece.t) - edge, max(1, round(1.0 / (2.0 * cutoff * piece.dt))))


def rows_at(made: Probe, cutoff: float, inertial: bool = False) -> tuple[Block, ...]:
    """Return the rows at a cutoff, Hz; with `inertial`, A is only what the acceleration makes of the base columns."""
    return tuple(filtered(made, cutoff, inertial))


def filtered(made: Probe, cutoff: float, inertial: bool) -> Iterator[Block]:
    """Yield one block per piece that is longer than the filter."""
    for part in made.pieces:
        keep = kept(part, cutoff)
        if keep.start < keep.stop:
            columns = part.inertial if inertial else part.A
            A = np.zeros((len(range(*keep.indices(len(part.t)))), *columns.shape[1:]))
            present = np.any(columns != 0.0, axis=0)
            A[:, present] = blurred(columns[:, present], cutoff, part.dt)[keep]
            b, share = (blurred(x, cutoff, part.dt)[keep] for x in (part.b, part.open))
            yield Block(part.t[keep], A, b, part.v[keep], share)


def rms(parts: Sequence[Array]) -> Array:
    """Root mean square over all rows, per joint, (n,)."""
    return np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))
