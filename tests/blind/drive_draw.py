"""Plans as people would make them: of all lengths, on gimbals and arms, with repeats and turns, joints left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TypeVar

import numpy as np
from numpy.random import Generator

from .plan import SHARES, DrivePlan, Hidden, Plan

T = TypeVar("T")
MIX = (*4 * ("plain",), *3 * ("many-joints",), *2 * ("short",), *2 * ("turning",), "long")
"""Variants, as often as they are drawn."""
SECONDS = {
    "plain": (12, 61),
    "many-joints": (15, 46),
    "short": (5, 9),
    "turning": (20, 91),
    "long": (300, 601),
}
RATES: dict[str, tuple[float, ...]] = {
    "plain": (100.0, 200.0, 250.0, 300.0, 500.0, 1000.0),
    "many-joints": (100.0, 125.0, 250.0, 500.0),
    "short": (200.0, 300.0, 500.0, 1000.0),
    "turning": (200.0, 400.0, 500.0, 1000.0),
    "long": (100.0, 200.0, 250.0),
}
DRIVE_SHARES = dict(zip(SHARES, (0.06, 0.12, 0.2, 0.3, 0.45), strict=True))
"""Sizes of effects beside a noise of 1–5 %, for the sizes of the other strata."""
LONG_MOTIONS = ("multisine", "chirp", "staircase")
SETTLED = ("cable-spring", "rubbing-stop", "hysteretic-cable", "friction-spots")
"""Effects of a place in a joint's travel, which a joint that turns on and on does not have."""
ALIGNED = ("delay", "actuator-lag")
"""Effects that a shift between channels looks like."""


def spread(rng: Generator, values: Sequence[T], count: int) -> list[T]:
    """Every value equally often (to one), in random order."""
    offset = int(rng.integers(len(values)))
    rows = rng.permutation(count)
    return [values[int(row + offset) % len(values)] for row in rows]


def _variant(wanted: str, plan: Plan, light: bool) -> str:
    """The wanted variant, or the plain one where the hidden effect makes no sense in it or takes too long."""
    out_of_place = wanted == "turning" and any(item.cause in SETTLED for item in plan.hidden)
    return "plain" if out_of_place or (wanted == "long" and not light) else wanted


def _axes(rng: Generator, variant: str, arm: bool, plan: Plan) -> int:
    if variant == "many-joints":
        return int(rng.integers(4, 8))
    return max(plan.axes, int(rng.integers(1, 5))) if arm and variant == "plain" else plan.axes


def _dress(rng: Generator, plan: Plan, variant: str, needed: int) -> DrivePlan:
    arm = variant == "many-joints" or (variant in ("plain", "short") and rng.random() < 0.4)
    idle = (
        ""
        if plan.trusted or rng.random() < 0.7
        else str(rng.choice(["held", "unlogged", "bolted"]))
    )
    axes = max(_axes(rng, variant, arm, plan), needed + bool(idle))
    seconds = float(rng.integers(*SECONDS[variant]))
    again = variant in ("plain", "many-joints", "long") and seconds >= 20.0 and rng.random() < 0.5
    long = variant == "long" and plan.excitation not in LONG_MOTIONS
    changed = {
        "hidden": tuple(Hidden(h.cause, h.form, DRIVE_SHARES[h.share], h.place) for h in plan.hidden),
        "axes": axes if arm else min(axes, 3), "level": "drive", "rate": float(rng.choice(RATES[variant])),
        "excitation": str(rng.choice(LONG_MOTIONS)) if long else plan.excitation, "seconds": seconds,
    }  # fmt: skip
    return DrivePlan(
        **{field.name: getattr(plan, field.name) for field in fields(Plan)} | changed,
        variant=variant,
        arm=arm,
        repeats=int(rng.integers(4, 6)) if again else 1,
        turns=float(np.exp(rng.uniform(0.0, np.log(100.0)))) if variant == "turning" else 0.0,
        idle=idle if changed["axes"] >= needed + bool(idle) else "",
        camera_off=float(rng.choice([-0.2, 0.0, 0.2])),
        aligned=any(item.cause in ALIGNED for item in plan.hidden),
    )


def dressed(
    rng: Generator, plans: Sequence[Plan], needed: Sequence[int], light: Sequence[bool]
) -> list[DrivePlan]:
    """The same plans in people's logs; `needed`: axes that the hidden needs; `light`: it may run for ten minutes."""
    variants = spread(rng, MIX, len(plans))
    rows = zip(plans, variants, needed, light, strict=True)
    return [
        _dress(rng, plan, _variant(variant, plan, quick), least)
        for plan, variant, least, quick in rows
    ]
