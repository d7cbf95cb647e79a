"""What checks return: faults of a log, and the alterations that mend them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import nan
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits, finite_or_none
from gimbal_pin.log.io.columns import log_columns
from gimbal_pin.log.log import PLAUSIBLE_RANGES, Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig

REASONS: Mapping[str, str] = MappingProxyType(
    {
        "contradicting-gyro": "it shows another motion than the base and the encoders, however it is turned",
        "imu-mounting": "the IMU sits askew or its gyro is biased, by the other gyros and the encoders",
        "rates-from-gyros": "the log holds no joint rates, and its gyros show them",
        "clock": "stamps are false, or rows repeat the row before",
        "stuck-channel": "a channel stands still while its joint moves on",
        "outliers": "they are wild, and their neighbours are not",
        "filtered-velocity": "the rate is late, or the angle behind a low-pass",
        "commanded-torque": "the motor cannot have followed the command beyond its limit",
    }
)
"""Why data are altered, by what asks for it."""
Kind = Literal["changed", "rows-left-out", "channel-left-out", "channel-added"]


@dataclass(frozen=True)
class Alteration:
    """One change of a log's data, as the comparison of the log before and after shows it.

    Attributes:
        cause: What asks for it, one of `REASONS`.
        kind: What is done.
        channel: The channel, by its column, without the axis where it has three; empty for whole rows.
        samples: How many samples are concerned.
        first: Time of the first of them, s.
        last: Time of the last, s.
        size: Largest change, in `unit`; nan where nothing can be compared.
        unit: Unit of the channel.
    """

    cause: str
    kind: Kind
    channel: str
    samples: int
    first: float
    last: float
    size: float = nan
    unit: str = ""

    def __str__(self) -> str:
        """Say what is done to which samples, and why."""
        which = f"{self.samples} sample{'s' * (self.samples > 1)} from {self.first:.6g} to {self.last:.6g} s"
        what = {
            "changed": f"{which} changed by up to {digits(self.size, 2)} {self.unit}",
            "rows-left-out": f"{which} left out",
            "channel-left-out": "left out",
            "channel-added": "added",
        }[self.kind]
        return f"{self.channel or 'all channels'}: {what}: {REASONS[self.cause]}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data; a size that there is not is null."""
        return {**vars(self), "size": finite_or_none(self.size)}


def list_alterations(altered: Mapping[str, tuple[Alteration, ...]]) -> list[dict[str, Any]]:
    """Return what JSON holds of the alterations of some logs, by their names."""
    return [{"log": log, **one.to_dict()} for log, each in altered.items() for one in each]


def compare_logs(rig: Rig, cause: str, before: Log, after: Log) -> tuple[Alteration, ...]:
    """Return what differs between two logs: rows that are missing, channels, and samples of the rows that both have.

    Args:
        rig: Their rig, whose joints' units are told.
        cause: What altered the log.
        before: The log.
        after: The same altered: some of its rows at their times, or all of them.
    """
    if after is before:
        return ()
    out = list[Alteration]()
    kept = np.isin(before.t, after.t) if len(after) < len(before) else np.ones(len(before), bool)
    if not kept.all():
        out.append(_span(cause, "rows-left-out", "", before.t[~kept]))
    old, new = (_group_columns(log) for log in (before.part(np.flatnonzero(kept)), after))
    for channel in {**old, **new}:
        if channel not in new or channel not in old:
            kind: Kind = "channel-left-out" if channel in old else "channel-added"
            out.append(_span(cause, kind, channel, after.t))
        elif (change := np.abs(new[channel] - old[channel]).max(axis=1)).any():
            prefix, _, joint = channel.partition("_")
            unit = rig.in_units(
                joint, PLAUSIBLE_RANGES[{"dq": "v", "temp": "temperature"}.get(prefix, prefix)].unit
            )
            one = _span(cause, "changed", channel, before.t[kept][change > 0])
            out.append(replace(one, size=float(change.max()), unit=unit))
    return tuple(out)


def _span(cause: str, kind: Kind, channel: str, t: Array) -> Alteration:
    """Return an alteration of the samples at these times."""
    return Alteration(cause, kind, channel, len(t), float(t[0]), float(t[-1]))


def _group_columns(log: Log) -> dict[str, Array]:
    """Return channel → (N, k): a joint's column, or the axes of an IMU's sensor together."""
    groups = dict[str, list[Array]]()
    for name, values in log_columns(log).items():
        of_imu = name.split("_", 1)[0] in ("gyro", "accel", "quat")
        groups.setdefault(name.rsplit("_", 1)[0] if of_imu else name, []).append(values)
    return {name: np.stack(columns, axis=1) for name, columns in groups.items()}


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a log.

    Attributes:
        cause: Name of the fault of the data, as `diagnose` says it.
        joint: The joint concerned most; None for the whole log.
        sentence: What is wrong, for one who builds rigs.
        parameters: What was measured, with deviations and units.
        strength: How far beyond what is admissible: over one is found.
        makes_physics_unreliable: Whether a fit of the log as it was recorded would show the wrong physics.
        next_experiment: What to record or to change.
        slight: Whether it is worth a note only: it does this log no harm, though it might another.
        answer: Base parameters and friction estimated in spite of the fault, where there is such an estimate.
    """

    cause: str
    joint: str | None
    sentence: str
    parameters: tuple[Parameter, ...]
    strength: float
    makes_physics_unreliable: bool
    next_experiment: str
    answer: tuple[Parameter, ...] = ()
    slight: bool = False

    def in_units(self, rig: Rig) -> Fault:
        """Return it in the units of its joint: see `Rig.in_units`."""
        shown = tuple(replace(p, unit=rig.in_units(self.joint, p.unit)) for p in self.parameters)
        return replace(self, sentence=rig.in_units(self.joint, self.sentence), parameters=shown)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds of a data finding; the figures of physical findings are null."""
        physical = ("probability", "gain", "explained_share")
        return {
            "cause": self.cause,
            "joint": self.joint,
            "status": "data",
            "class": [self.cause],
            "parameters": describe_parameters(self.parameters),
            **dict.fromkeys(physical),
            "rivals": [],
            "sentence": self.sentence,
            "next_experiment": self.next_experiment,
            "strength": self.strength,
            "makes_physics_unreliable": self.makes_physics_unreliable,
            "answer": describe_parameters(self.answer),
        }


class Examined(NamedTuple):
    """A fault, and the log to go on with: the last of its repairs, one after another; none: as it was."""

    fault: Fault
    repairs: tuple[Log, ...] = ()


Check = Callable[[Rig, Log, Filtering], "Examined | None"]
"""Examines one trajectory for one cause."""


def describe_parameters(parameters: tuple[Parameter, ...]) -> dict[str, dict[str, Any]]:
    """Return name → value, std, unit and whether it is known; a deviation that was not estimated is null."""
    return {
        p.name: {
            "value": p.value,
            "std": finite_or_none(p.std),
            "unit": p.unit,
            "is_known": p.is_known,
        }
        for p in parameters
    }
