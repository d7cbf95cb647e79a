"""A channel that repeats its value, or ends at a rail, while the joint goes on moving."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from gimbal_pin import signals
from gimbal_pin.diagnosis.audit.base import Fault, stated
from gimbal_pin.diagnosis.audit.local import constant, level, run_edges
from gimbal_pin.diagnosis.audit.mend import CHANNELS, changed, taken, without
from gimbal_pin.diagnosis.audit.probe import probe, rows_at
from gimbal_pin.diagnosis.audit.quantisation import quantum
from gimbal_pin.estimators.base import residuals
from gimbal_pin.estimators.weighted import weighted
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering, Flags, dilated

WORDS = {"q": "angle", "v": "rate", "tau": "torque"}
LOUD = 4.0
"""What the other channels deny must be so many times what they differ by elsewhere."""
SHARE = 0.05
"""And this share of the channel's own spread."""
STEPS = 4.0
"""Steps of its encoder by which an angle must have moved on unseen."""
SMOOTH = 32.0
"""Low-pass on the angle before it is differentiated, Hz."""


class Held(NamedTuple):
    """Rows in which one channel of one joint does not change, (N,), and how far the other channels deny it."""

    channel: str
    joint: int
    rows: Flags
    loudness: float


@dataclass(frozen=True)
class StuckChannel:
    """``x_k = x_{k-1}`` over a stretch in which the other channels say that x must change.

    Angle and rate deny each other: their difference ``v - dq/dt`` over the held samples against elsewhere. A torque is
    denied by the model that the other samples give: a motor that is switched off, or a drive at its limit, holds its
    torque too, and the model agrees. Without a rate, an angle is stuck if it jumps when it is released.
    """

    name: ClassVar[str] = "stuck-channel"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("seconds", 1.5, "s", 0.05, 60.0),
        Parameter("channel", 2.0, "0 angle, 1 rate, 2 torque", 0.0, 2.0),
        Parameter("rail", 0.0, "quantile, 0 for none", 0.0, 1.0),
    )

    def examine(self, rig: Rig, log: Log) -> Fault | None:
        """Return the loudest stuck channel, or None."""
        found = [held for held in candidates(rig, log) if held.loudness > LOUD]
        if not found:
            return None
        worst = max(found, key=lambda held: float(np.mean(held.rows)))
        bad = np.any([held.rows for held in found], axis=0)
        mended = without(log, dilated(bad[:, None], 2)[:, 0], f"{int(bad.sum())} rows of a stuck channel were cut out")
        return told(rig, log, worst, len(found), mended)

    def corrupt(self, log: Log, rng: np.random.Generator, **shape: float) -> Log:
        """Hold one channel of one joint for some seconds, or clip it at a quantile of its size."""
        size = stated(self, shape)
        name = CHANNELS[int(size["channel"])]
        values = np.array(getattr(log, name))
        j = int(rng.integers(len(log.joints)))
        if size["rail"]:
            rail = np.quantile(np.abs(values[:, j]), size["rail"])
            values[:, j] = np.clip(values[:, j], -rail, rail)
        else:
            length = min(round(size["seconds"] / log.dt), len(log) // 2)
            starts = np.arange(0, len(log) - length, max(length // 4, 1))
            spread = np.array([np.std(values[k : k + length, j]) for k in starts])
            begin = int(rng.choice(starts[spread >= np.median(spread)]))
            values[begin : begin + length, j] = values[begin, j]
        return changed(log, {name: values})


def candidates(rig: Rig, log: Log) -> Iterator[Held]:
    """Yield every channel that is constant somewhere, with what the others say to it."""
    dt = log.dt
    derived = np.gradient(signals.zero_phase(log.q, signals.lowpass(SMOOTH, 1.0 / dt)), log.t, axis=0)
    for j in range(rig.n):
        constants = {name: constant(x[:, j], dt) for name in CHANNELS if (x := getattr(log, name)) is not None}
        if log.v is not None:
            yield from contradicted(log, j, log.v[:, j] - derived[:, j], constants)
        elif constants["q"].any():
            yield Held("q", j, *released(log.q[:, j], constants["q"]))
        if "tau" in constants and constants["tau"].any():
            yield Held("tau", j, constants["tau"], denied_torque(rig, log, j, constants["tau"]))


def contradicted(log: Log, j: int, apart: Array, constants: Mapping[str, Flags]) -> Iterator[Held]:
    """Yield angle and rate with those runs in which ``apart = v - dq/dt`` is loud; of two at once, the longer."""
    assert log.v is not None
    free = ~(constants["q"] | constants["v"])
    rest = max(level(apart[free]) if free.any() else 0.0, float(signals.noise_std(log.v[:, j : j + 1])[0]))
    bound = max(LOUD * rest, SHARE * float(np.std(log.v[:, j])))
    # An angle stands still for as long as it takes to travel one step of its encoder.
    least = {"q": STEPS * quantum(log.q[:, j]) / log.dt, "v": 0.0}
    loud = {name: lasting(apart, constants[name], bound, least[name]) for name in ("q", "v")}
    for name, other in (("q", "v"), ("v", "q")):
        rows = loud[name]
        both = rows & loud[other]
        if rows.any() and not (both.any() and rows.sum() < loud[other].sum()):
            yield Held(name, j, rows, float(np.sqrt(np.mean(apart[rows] ** 2))) / max(rest, 1e-300))


def lasting(apart: Array, rows: Flags, bound: float, least: float) -> Flags:
    """Those runs of `rows` over which the rms of `apart` exceeds the bound and its sum the least, (N,)."""
    edges = run_edges(np.append(True, np.diff(rows.astype(int)) != 0))
    lengths = np.diff(edges)
    size = np.sqrt(np.add.reduceat(apart**2, edges[:-1]) / lengths)
    travel = np.abs(np.add.reduceat(apart, edges[:-1]))
    return np.asarray(rows & np.repeat((size > bound) & (travel > least), lengths))


def released(column: Array, rows: Flags) -> tuple[Flags, float]:
    """Runs that an angle leaves with a jump, (N,), and the largest jump over its ordinary change between samples."""
    changes = np.abs(np.diff(column))
    ordinary = max(float(np.quantile(changes, 0.99)), 1e-300)
    ends = np.flatnonzero(rows[:-1] & ~rows[1:])
    jumps = ends[changes[ends] > max(LOUD * ordinary, SHARE * float(np.std(column)))]
    out = np.zeros(len(rows), bool)
    for end in jumps.tolist():
        still = np.flatnonzero(column[: end + 1] != column[end])
        out[still[-1] + 1 if len(still) else 0 : end + 1] = True
    return out, float(changes[jumps].max() / ordinary) if len(jumps) else 0.0


def denied_torque(rig: Rig, log: Log, j: int, rows: Flags) -> float:
    """Residual over the held rows under the model that the others give, over what it should be; 0 where that is little.

    What it should be is the residual elsewhere and the model's own uncertainty there: a motor that was off while the
    pendulum swung, and on only in slow motion, denies nothing.
    """
    cutoff = Filtering().cutoff
    if rows.all():
        return float("inf") if np.ptp(log.q[:, j]) > 0 else 0.0
    every, fitted = (rows_at(probe(rig, one), cutoff) for one in (log, taken(log, np.flatnonzero(~rows))))
    if not fitted or sum(block.b.size for block in fitted) < 3 * fitted[0].A.shape[2]:
        return 0.0
    found = weighted(fitted)
    t, error, torque, A = (
        np.concatenate(x) for x in zip(*((b.t, residuals(b, found.theta)[:, j], b.b[:, j], b.A[:, j]) for b in every))
    )
    held = np.interp(t, log.t, rows.astype(float)) > 0.5
    if not held.any() or held.all() or not np.isfinite(found.covariance).all():
        return 0.0
    unsure = np.einsum("tk,kl,tl->t", A[held], found.covariance, A[held])
    inside, expected = np.sqrt(np.mean(error[held] ** 2)), np.sqrt(level(error[~held]) ** 2 + np.mean(unsure))
    return float(inside / max(expected, 1e-300)) if inside > SHARE * np.std(torque) else 0.0


def told(rig: Rig, log: Log, worst: Held, count: int, mended: Log | None) -> Fault:
    """Return the fault with its figures and what to do."""
    joint, what = rig.joints[worst.joint], WORDS[worst.channel]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], worst.rows, [0]]).astype(int)))
    longest = float((edges[1::2] - edges[::2]).max()) * log.dt
    share = float(np.mean(worst.rows))
    severity = (
        Parameter("longest", longest, "s"),
        Parameter("share", share, "1"),
        Parameter("contradiction", worst.loudness, "1"),
    )
    more = f" ({count} channels in all)" if count > 1 else ""
    sentence = (
        f"{joint}: the {what} stands still for up to {longest:.2g} s ({100 * share:.2g} % of the log) while the joint "
        f"moves on{more}"
    )
    mend = f"check the {what} sensor's wiring, range and bus messages, and record again"
    return Fault(StuckChannel.name, joint, severity, True, sentence, mend, mended)
