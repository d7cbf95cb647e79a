"""How still the camera stood: one run, all runs of a controller, all controllers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees, nan, sqrt
from typing import Any, ClassVar

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.control.laws.loop import Margins
from gimbal_pin.log.limited import compute_limit_shares
from gimbal_pin.log.log import Array, freeze
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig

SLOW = 0.2
"""Corner between jitter and drift, Hz."""
SETTLING = 2.0
"""Beginning of a run that is not counted, s (the same)."""
SHORTEST_JITTER = 0.5 / SLOW
"""Shortest time that the high-pass of the jitter needs, s: half of the corner's period."""
SHORTEST_DRIFT = 1 / SLOW
"""Shortest time that shows a drift, s: the corner's period. In half of it a slow swing may not leave its start."""


def split(error: Array, dt: float) -> tuple[Array, Array]:
    """Part an error, (N, k), into what is faster than `SLOW`, by a second-order zero-phase high-pass, and the rest.

    A run too short to show such slow motion is parted at its mean.
    """
    sections = butter(2, SLOW, btype="highpass", fs=1 / dt, output="sos")
    pad = min(len(error) - 1, round(1 / SLOW / dt))
    fast = (
        sosfiltfilt(sections, error, axis=0, padlen=pad)
        if len(error) * dt > SHORTEST_JITTER
        else error - error.mean(0)
    )
    return fast, error - fast


def jitter(error: Array, dt: float) -> tuple[float, float, float]:
    """Jitter rms, jitter max and drift (how far the slow part goes from its start) of (e_y, e_z), rad, (N, 2).

    The drift is NaN in less than `SHORTEST_DRIFT`.
    """
    fast, slow = split(error, dt)
    size = np.hypot(*fast.T)
    drift = float(np.hypot(*(slow - slow[0]).T).max()) if len(error) * dt >= SHORTEST_DRIFT else nan
    return float(np.sqrt(np.mean(size**2))), float(size.max()), drift


def summed(events: Iterable[str]) -> tuple[str, ...]:
    """Return events ``TIME s: WHAT``, those that differ in figures only as the earliest of them with their count."""
    kinds: dict[str, list[tuple[float, str]]] = {}
    for event in events:
        found = re.fullmatch(r"(-?[\d.]+) s: (.*)", event, re.DOTALL)
        kind = re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", found[2] if found else event)
        kinds.setdefault(kind, []).append((float(found[1]) if found else 0.0, event))
    return tuple(
        min(same)[1] + f" ({len(same)} times)" * (len(same) > 1) for same in kinds.values()
    )


@dataclass(frozen=True, eq=False)
class Pointing:
    """One run of one controller on one platform's motion.

    Attributes:
        controller: The controller's name.
        platform: "S" or "log".
        seed: Seed of the run.
        joints: Joint names.
        t: Time, s, (N,).
        error: ``log(R_dᵀ R)`` in the camera's frame: about the line of sight, then the two across it, rad, (N, 3).
        q: True angles, rad, (N, n).
        tau: Torque that was commanded for each interval, clipped, N m, (N, n).
        base: Attitude of the platform in the world, (w, x, y, z), (N, 4).
        tau_max: Largest torque of each motor, N m, (n,).
        events: What happened, in sentences.
    """

    controller: str
    platform: str
    seed: int
    joints: tuple[str, ...]
    t: Array
    error: Array
    q: Array
    tau: Array
    base: Array
    tau_max: Array
    events: tuple[str, ...] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        samples = len(self.t)
        n = len(self.joints)
        for name, shape in (("t", ()), ("error", (3,)), ("q", (n,)), ("tau", (n,)), ("base", (4,))):
            object.__setattr__(
                self, name, freeze(getattr(self, name), (samples, *shape), f"pointing: {name}")
            )

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float(self.t[1] - self.t[0])

    @property
    def counted(self) -> slice:
        """Samples that count: all but the first `SETTLING` s, or the first quarter of a run too short for jitter."""
        samples = len(self.t)
        start = round(SETTLING / self.dt)
        return slice(start if (samples - start) * self.dt > SHORTEST_JITTER else samples // 4, None)

    @property
    def sight(self) -> Array:
        """Line-of-sight error of the samples that count, rad, (M, 2)."""
        return self.error[self.counted, 1:]

    @cached_property
    def jitter(self) -> tuple[float, float, float]:
        """Jitter rms, jitter max, drift, rad."""
        return jitter(self.sight, self.dt)


@dataclass(frozen=True, eq=False)
class Row:
    """One controller's runs, one per seed."""

    controller: str
    runs: tuple[Pointing, ...]

    __repr__ = brief

    @property
    def jitter_rms(self) -> float:
        """Over all runs, rad."""
        return sqrt(float(np.mean([run.jitter[0] ** 2 for run in self.runs])))

    @property
    def jitter_max(self) -> float:
        """The largest of all runs, rad."""
        return max(run.jitter[1] for run in self.runs)

    @property
    def drift(self) -> float:
        """Mean of the runs', rad."""
        return float(np.mean([run.jitter[2] for run in self.runs]))

    @cached_property
    def tau(self) -> Array:
        """Torque over the samples that count, run after run, N m, (M, n)."""
        return np.concatenate([run.tau[run.counted] for run in self.runs])

    @property
    def torque_rms(self) -> Mapping[str, float]:
        """Joint → torque over all runs, N m rms."""
        return dict(zip(self.runs[0].joints, np.sqrt(np.mean(self.tau**2, axis=0)).tolist()))

    @property
    def at_limit(self) -> Mapping[str, float]:
        """Joint → share of the time at the motor's limit."""
        return compute_limit_shares(self.runs[0].joints, self.tau, self.runs[0].tau_max)

    @property
    def events(self) -> tuple[str, ...]:
        """What happened in any of the runs, each once."""
        return tuple(dict.fromkeys(event for run in self.runs for event in run.events))

    @property
    def happened(self) -> tuple[str, ...]:
        """The events of all runs, each kind once, with its count."""
        return summed(event for run in self.runs for event in run.events)

    def to_dict(self) -> dict[str, Any]:
        """Return what `track --json` writes."""
        return {
            "controller": self.controller,
            "platform": self.runs[0].platform,
            "seeds": len(self.runs),
            "jitter_rms_deg": degrees(self.jitter_rms),
            "jitter_max_deg": degrees(self.jitter_max),
            "drift_deg": degrees(self.drift),
            "torque_rms": dict(self.torque_rms),
            "at_limit": dict(self.at_limit),
            "events": list(self.events),
        }


@dataclass(frozen=True, eq=False)
class Verified(Record):
    """The result of `verify`.

    Attributes:
        rig: The rig.
        rows: The PID's runs, and those of computed torque.
        loops: Controller → the margins of its loops, joint by joint.
        note: What the plant and the model were, in sentences; "": nobody says.
    """

    rig: Rig
    rows: tuple[Row, ...]
    loops: Mapping[str, tuple[Margins, ...]]
    note: str = ""

    ROWS: ClassVar[str] = "pointing"
    __repr__ = brief

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names."""
        return self.rows[0].runs[0].joints

    @property
    def jitter(self) -> Mapping[str, float]:
        """Controller → jitter, rad rms."""
        return {row.controller: row.jitter_rms for row in self.rows}

    @property
    def gain(self) -> float:
        """Jitter of the PID over that of computed torque."""
        return self.jitter[BASELINE] / self.jitter[OURS]

    @property
    def is_equal(self) -> bool:
        """Whether both have loops of the same margins."""
        return self.loops[BASELINE] == self.loops[OURS]

    def to_dict(self) -> dict[str, Any]:
        """Return what `track --json` writes."""
        loops = {
            name: {joint: vars(own) for joint, own in zip(self.joints, x)}
            for name, x in self.loops.items()
        }
        rows = [row.to_dict() for row in self.rows]
        return {
            "rig": self.rig.name,
            "payload": self.rig.payload,
            "pointing": rows,
            "pointing_loops": loops,
        }
