"""Logs as evidence: torque and columns, masked near standstill, whitened by the sensors' noise, in rows to 2 × band.

log → smoothed channels → columns at full rate → × gate → spectrum ÷ noise floor → rows of unit noise
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.sensor_noise import compute_noise_floor
from gimbal_pin.dynamics.regressor import compute_gravity
from gimbal_pin.effects import Sample, Signal
from gimbal_pin.effects.base import AMBIENT
from gimbal_pin.effects.losses import Losses
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.errors import DataError
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import Platform
from gimbal_pin.regression import (
    Filtering,
    Flags,
    Samples,
    Segment,
    UnfilteredTorque,
    build_mask,
    compute_decimation,
    compute_direction,
    compute_lost_impulse,
    compute_settling_time,
    count_smoother_memory,
    dilate_flags,
    find_moving_base,
    find_slow_samples,
    smooth_samples,
    split_segments,
)
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

ERROR_BLOCKS = 40
"""Blocks of time that errors are counted by."""
SHORTEST_ERROR_BLOCK = 0.7
"""Shortest such block, s."""
TAPER = 0.5
"""Width over which the gate opens, in periods of the band: sharp edges fold what is above the band into it."""
UNFITTED_TAPER = 0.05
"""The same where nothing is fitted."""
CLEAR = 4.0
"""A rate under this many of its deviations does not tell its sign: at it one in 30 000 is wrong. Identification, which
averages over directions that are wrong now and then, takes half as many; a cause is told by less."""
INERTIA_POSES = 50
"""Poses at which a joint's axis is looked at, and over which its inertia is averaged."""
FELT = 1e-9
"""Share of the largest weight felt from which a joint feels any."""
PHASOR_OCTAVES = 9
"""Powers of two of the phasor of an angle that are kept: harmonics up to 511."""
COVERED = 0.5
"""Share of the time that stretches without holes must cover, under which lone samples are judged."""


class LogStretch(NamedTuple):
    """One stretch of a log.

    Attributes:
        channels: Smoothed channels on a uniform grid, (m,) and (m, n).
        temperature: Motor temperatures, °C, (m, n).
        gate: Weight of each sample, (m, n): 0 near standstill and at the ends.
        whitener: Gain of each joint's whitening filter at the kept frequencies, (n, f).
        shaken: Power of what the angles' and rates' noise leaves in each joint's rows before they are whitened, (N m)²,
            (n, f).
        origin: Time at which its log began, s.
        dt: Interval of the grid, s.
        rows: How many rows it gives.
        impulse: What the smoother takes off the torque's impulse at the nearest turn of a joint, N m s, (m, n).
        corner: What it takes off the rates where joints turn, rad/s, (m, n), as far as that is known.
        losses: What each motor turned into heat since its log began, (n); None: nobody knows.
        logged: The torque before it was smoothed; None: nobody knows.
        late: By how much later than it was smoothed each joint's torque was found to act, s, (n,).
    """

    channels: Samples
    temperature: Array
    gate: Array
    whitener: Array
    shaken: Array
    origin: float
    dt: float
    rows: int
    impulse: Array
    corner: Array | float = 0.0
    losses: tuple[Losses, ...] | None = None
    logged: UnfilteredTorque | None = None
    late: Array | float = 0.0

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    def whiten(self, signal: Array, joint: int) -> Array:
        """Gate a torque at one joint, N m, (m,) or (m, k), and whiten it: (rows,) or (rows, k), unit noise."""
        return fft.irfft(self.transform(signal, joint), self.rows).T * (self.rows / len(self.gate))

    def transform(self, signal: Array, joint: int) -> Array:
        """Gate a torque at one joint, N m, (m,) or (m, k), and whiten it: its spectrum, (f,) or (k, f)."""
        return (
            fft.rfft(signal.T * self.gate[:, joint])[..., : self.whitener.shape[1]]
            * self.whitener[joint]
        )

    def acted(self, signal: Signal, torque: Array, joint: int, borne: JointLoad | None) -> Array:
        """Torque that acts, N m, (m,), where a signal is given one at a joint, N m, (m,).

        What jumps with the command does so at each sample of the log: a torque that crosses the edge from one sample to
        the next lies far from it once it is smoothed, and what a gap passes on hangs on when its sign changed.
        """
        if (
            signal.abrupt
            and self.logged is not None
            and np.array_equal(torque, self.channels.tau[:, joint])
        ):
            command = self.logged.tau[:, joint]
            loss = self.logged.smoothed(
                command - signal.acting(command, self.dt / self.logged.step)
            )
            return torque - shift_in_time(
                loss, np.broadcast_to(self.late, self.gate.shape[1:])[joint], self.dt
            )
        return signal.along(torque, self.dt, borne)

    def lost(self, signal: Signal, torque: Array, joint: int, borne: JointLoad | None) -> Array:
        """What a signal at a joint takes from the torques of all, N m, (m, n), that it is given, (m, n)."""
        loss = torque[:, joint] - self.acted(signal, torque[:, joint], joint, borne)
        return signal.spread(loss, joint, torque.shape[1], borne)

    def retimed(self, late: Array) -> LogStretch:
        """Return the part as it is where the joints' torques act later than they were smoothed, s, (n,)."""
        more = np.broadcast_to(late - self.late, self.gate.shape[1:])
        tau = [shift_in_time(x, by, self.dt) for x, by in zip(self.channels.tau.T, more.tolist())]
        return self._replace(channels=self.channels._replace(tau=np.stack(tau, axis=1)), late=late)

    @property
    def still(self) -> Flags:
        """Where a joint stands, as far as its rate tells, (m, n)."""
        return np.asarray(np.abs(self.channels.v) < CLEAR * self.channels.rate_std)

    @property
    def slide(self) -> Array:
        """Mean direction of each joint over each sample, in [-1, 1], (m, n)."""
        return compute_direction(self.channels.v + self.corner, self.channels.a, self.dt)

    @property
    def time(self) -> Array:
        """Time since the log began, s, (m,)."""
        return self.channels.t - self.origin

    @property
    def platform(self) -> Platform | None:
        """Motion of the base over `time`; None where it stands."""
        moving = self.channels.platform
        return None if moving is None else replace(moving, t=self.time)

    def sample(self, joint: int) -> Sample:
        """Return the joint's channels as effects read them, with the measured torque; each side by side in memory."""
        c = self.channels
        every = (c.q, c.v, c.a, self.slide, c.tau, self.temperature)
        q, v, a, slide, tau, warm = (np.ascontiguousarray(x[:, joint]) for x in every)
        turns = [np.exp(1j * q)]
        for _ in range(1, PHASOR_OCTAVES):
            turns.append(turns[-1] ** 2)
        losses = None if self.losses is None else self.losses[joint]
        return Sample(self.time, q, v, a, slide, tau, warm, turns=np.stack(turns), losses=losses)


@dataclass(frozen=True, eq=False)
class Evidence:
    """All parts of some logs.

    Attributes:
        rig: The rig.
        parts: The stretches.
        band: Highest frequency kept, Hz.
        block: Block of time that each row belongs to, (rows,).
        seen: Joint → what the logs show of it.
    """

    rig: Rig
    parts: tuple[LogStretch, ...]
    band: float
    block: Array
    seen: tuple[OperatingRange, ...]

    __repr__ = brief

    @property
    def rows(self) -> int:
        """Rows per joint."""
        return sum(part.rows for part in self.parts)

    def whiten(self, torques: Sequence[Array], joint: int) -> Array:
        """Whiten a torque at one joint, one array per part: (rows,) or (rows, k)."""
        return np.concatenate(
            [part.whiten(torque, joint) for part, torque in zip(self.parts, torques)]
        )

    def rewhiten(self, rows: Array, before: Evidence, joint: int | None) -> Array:
        """Return rows of the same logs as another evidence whitens them, (rows, ...), as this one does.

        Every row is known by its spectrum, so another pass over the log is not needed.

        Args:
            rows: The other's rows of one joint, (rows,) or (rows, c), or of all, (rows, n) or (rows, n, c).
            before: The other.
            joint: The joint; None: all.
        """
        out = []
        first = 0
        for old, new in zip(before.parts, self.parts):
            spectrum = fft.rfft(rows[first : first + old.rows].T)
            first += old.rows
            was, now = (x.whitener if joint is None else x.whitener[joint] for x in (old, new))
            ratio = np.divide(now, was, out=np.zeros_like(now), where=was > 0)
            out.append(fft.irfft(spectrum[..., : ratio.shape[-1]] * ratio, old.rows).T)
        return np.concatenate(out)

    def whiten_all(self, torques: Sequence[Array]) -> Array:
        """Whiten torques of all joints, (m, n) or (m, n, k) per part: (rows, n) or (rows, n, k)."""
        return np.stack(
            [self.whiten([x[:, j] for x in torques], j) for j in range(self.rig.n)], axis=1
        )

    @cached_property
    def samples(self) -> list[list[Sample]]:
        """What effects read at each joint, per part."""
        return [[part.sample(j) for part in self.parts] for j in range(self.rig.n)]

    @cached_property
    def sliding(self) -> list[Array]:
        """Coulomb friction of one N m at each joint, whitened, (rows,)."""
        return [
            self.whiten([part.slide[:, j] for part in self.parts], j) for j in range(self.rig.n)
        ]

    @property
    def seconds(self) -> float:
        """Length of all parts, s."""
        return sum(part.dt * len(part.gate) for part in self.parts)

    def low_pass_motion(self, cutoff: float) -> Evidence:
        """Return it with its motion, not its torque, through a further low-pass at a cutoff, Hz."""
        parts = []
        for part in self.parts:
            sections = signals.lowpass(cutoff, 1.0 / part.dt)
            q, v = (signals.zero_phase(x, sections) for x in (part.channels.q, part.channels.v))
            slow = part.channels._replace(q=q, v=v, a=signals.differentiate(v, part.dt))
            parts.append(part._replace(channels=slow))
        return replace(self, parts=tuple(parts))

    @property
    def torque(self) -> list[Array]:
        """Measured torque, N m, (m, n) for each part."""
        return [part.channels.tau for part in self.parts]

    def noise_floor(self, joint: int) -> float:
        """What the sensors' noise alone leaves in the band, N m rms."""
        gains = [part.whitener[joint, : int(0.7 * part.whitener.shape[1])] for part in self.parts]
        power = [np.mean(1.0 / np.maximum(gain, 1e-300) ** 2) for gain in gains]
        return float(np.sqrt(np.mean(power)))

    @cached_property
    def used(self) -> Array:
        """Share of the samples that count, per joint, (n,)."""
        return np.mean(np.concatenate([part.gate**2 for part in self.parts]), axis=0)


def gather_for_judgement(
    rig: Rig,
    logs: Sequence[Log],
    filtering: Filtering,
    wholes: Mapping[str, Log] = MappingProxyType({}),
) -> Evidence:
    """Return what can be judged of logs that nothing is fitted to.

    Where holes leave too little of the time in stretches that the filters can settle in, every sample away from the
    holes is taken: angle and torque were measured there, and of the rate only its slow part and its sign matter much.
    Arguments are as for `gather`.

    Raises:
        DataError: Not even that.
    """
    whole = sum(float(log.t[-1] - log.t[0]) for log in logs)
    with contextlib.suppress(DataError):
        found = gather(rig, logs, filtering, wholes)
        if found.seconds >= COVERED * whole:
            return found
    return gather(rig, logs, filtering, wholes, compute_settling_time(filtering), UNFITTED_TAPER)


def gather(
    rig: Rig,
    logs: Sequence[Log],
    filtering: Filtering,
    wholes: Mapping[str, Log] = MappingProxyType({}),
    across: float = 0.0,
    taper: float = TAPER,
) -> Evidence:
    """Return the logs' evidence in the band below the filtering's cutoff.

    Args:
        rig: The rig.
        logs: Logs or parts of them.
        filtering: Its cutoff is the band.
        wholes: Name of a log → the whole log that it is a part of, where it is one: its motors were warm already.
        across: Holes up to so long, s, do not end a stretch; the gate is closed in them.
        taper: Width over which the gate opens, in periods of the band.

    Raises:
        DataError: No stretch is long enough.
    """
    found = [
        build_part(rig, stretch, filtering, taper, wholes.get(log.name, log))
        for log in logs
        for stretch in split_segments(log, filtering.cutoff, across)
    ]
    parts = tuple(one for one in found if one is not None)
    if not parts:
        name = logs[0].name if logs else "logs"
        raise DataError(
            name, "has no stretch of time long enough to judge", "record at least 10 s of motion"
        )
    return Evidence(
        rig,
        parts,
        filtering.cutoff,
        number_blocks(parts, filtering.cutoff),
        measure_ranges(rig, parts, filtering),
    )


def build_part(
    rig: Rig, stretch: Segment, filtering: Filtering, taper: float, whole: Log
) -> LogStretch | None:
    """Return the part of a stretch of a whole log, or None if it is shorter than what the filters need to settle."""
    step = compute_decimation(filtering, stretch.dt)
    # The last few samples go where that makes the Fourier transforms quick.
    half = fft.prev_fast_len(max(stretch.length // (2 * step), 1), real=True)
    length = 2 * step * half
    if 4 * int(np.ceil(compute_settling_time(filtering) / stretch.dt)) > length:
        return None
    channels = smooth_samples(stretch, filtering, 0, length, find_moving_base(rig, stretch.log))
    gate = compute_gate(channels, filtering, taper)
    length = 2 * half
    dt = stretch.dt * step
    rows = slice(0, length * step, step)
    shock = spread_from_turns(compute_lost_impulse(stretch, filtering, channels.t), channels.v)[
        rows
    ]
    logged = UnfilteredTorque.of(stretch, filtering, channels.t, step)
    channels = channels.select(rows)
    gate = gate[rows]
    log = stretch.log.part(stretch.rows)
    count = max(2 * round(length * dt * filtering.cutoff), 4)
    frequency = fft.rfftfreq(length, dt)[: count // 2 + 1]
    noise, shaken = compute_noise_floor(rig, log, frequency)
    share = 2 * filtering.cutoff * stretch.dt  # of a power within the band
    gain = compute_band_edge(frequency, filtering.cutoff) / np.sqrt((noise + shaken) * share)
    warm = np.full(channels.q.shape, AMBIENT)
    if log.temperature is not None:
        warm = np.stack([np.interp(channels.t, log.t, x) for x in log.temperature.T], axis=1)
    # Each joint's gate side by side in memory: every column is multiplied by it.
    return LogStretch(
        channels,
        warm,
        np.asfortranarray(gate),
        gain,
        shaken * share,
        float(whole.t[0]),
        dt,
        count,
        shock,
        0.0,
        tuple(Losses.along(whole.t, tau, channels.t) for tau in np.asarray(whole.tau).T),
        logged,
    )


def shift_in_time(signal: Array, by: float, dt: float) -> Array:
    """Return ``x(t - by)`` of a signal within its band, (m,); its ends are joined by a line, which has no echo."""
    if by == 0.0:
        return signal
    line = np.linspace(signal[0], signal[-1], len(signal))
    turn = np.exp(-2j * np.pi * by * fft.rfftfreq(len(signal), dt))
    slope = (signal[-1] - signal[0]) / (dt * max(len(signal) - 1, 1))
    return np.asarray(fft.irfft(fft.rfft(signal - line) * turn, len(signal)) + line - slope * by)


def compute_band_edge(frequency: Array, band: float) -> Array:
    """Return the gain at some frequencies, Hz, (f,), of a band, Hz, whose last quarter fades."""
    inside = np.clip((band - frequency) / (0.25 * band), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * inside))


def spread_from_turns(values: Array, v: Array) -> Array:
    """Values at the nearest sample at which each rate changes its sign, (m, n); zero where none does."""
    out = np.zeros_like(values)
    for j, rate in enumerate(v.T):
        turns = np.flatnonzero(rate[1:] * rate[:-1] < 0)
        if len(turns):
            nearest = np.searchsorted((turns[1:] + turns[:-1]) / 2, np.arange(len(rate)))
            out[:, j] = values[turns[nearest], j]
    return out


def compute_gate(channels: Samples, filtering: Filtering, taper: float = TAPER) -> Array:
    """Return the weight of each sample, (m, n): zero near standstill and where the filters settle, one elsewhere."""
    dt = float(channels.t[1] - channels.t[0])
    still = dilate_flags(
        find_slow_samples(channels, CLEAR), count_smoother_memory(channels, filtering)
    )
    edge = int(np.ceil(compute_settling_time(filtering) / dt))
    return (
        build_mask(still, round(taper / filtering.cutoff / dt))
        * compute_fade(len(channels.t), edge)[:, None]
    )


def compute_fade(length: int, edge: int) -> Array:
    """Zero over half of `edge` samples at both ends, then rising to one over the other half, (length,)."""
    rise = np.clip(
        (np.minimum(np.arange(length), np.arange(length)[::-1]) - edge / 2) / (edge / 2), 0.0, 1.0
    )
    return 0.5 - 0.5 * np.cos(np.pi * rise)


def number_blocks(parts: Sequence[LogStretch], band: float) -> Array:
    """Number of the block of time that each row belongs to, never across a part's ends, (rows,)."""
    total = sum(part.rows for part in parts)
    size = max(total / ERROR_BLOCKS, SHORTEST_ERROR_BLOCK * 2 * band)
    out = []
    first = 0
    for one in parts:
        count = max(1, round(one.rows / size))
        out.append(first + (np.arange(one.rows) * count) // one.rows)
        first += count
    return np.concatenate(out)


def measure_ranges(
    rig: Rig, parts: Sequence[LogStretch], filtering: Filtering
) -> tuple[OperatingRange, ...]:
    """What the parts show of each joint."""
    q, v, tau = (
        np.concatenate([getattr(part.channels, name) for part in parts])
        for name in ("q", "v", "tau")
    )
    seconds = sum(part.dt * len(part.gate) for part in parts)
    warm = any(np.ptp(part.temperature) > 0 for part in parts)
    rate_std = np.mean([part.channels.rate_std for part in parts], axis=0)
    upright = ~np.any(feels_weight(rig, parts), axis=0)
    return tuple(
        OperatingRange(
            seconds,
            parts[0].dt,
            filtering.cutoff,
            float(np.ptp(q[:, j])),
            float(np.quantile(np.abs(v[:, j]), 0.98)),
            float(rate_std[j]),
            float(np.quantile(np.abs(tau[:, j]), 0.98)),
            float(np.max(np.abs(tau[:, j]))),
            warm,
            bool(upright[j]),
            float(np.max(q[:, j]) + np.min(q[:, j])) / 2,
            float(np.sqrt(np.mean(tau[:, j] ** 2))),
        )
        for j in range(rig.n)
    )


def select_poses(every: Sequence[Samples]) -> Array:
    """Angles at moments that are spread evenly over some parts' channels, (INERTIA_POSES, n)."""
    q = np.concatenate([one.q for one in every])
    return np.asarray(q[np.linspace(0, len(q) - 1, INERTIA_POSES).astype(int)])


def feels_weight(rig: Rig, parts: Sequence[LogStretch]) -> Flags:
    """Whether the weight of anything is felt at each joint, at some of the angles, (INERTIA_POSES, n)."""
    pull = np.abs(compute_gravity(rig, select_poses([part.channels for part in parts])))
    moving = any(part.platform is not None for part in parts)
    return np.asarray((pull > FELT * np.max(pull, initial=1e-300)) | moving)
