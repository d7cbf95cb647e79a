"""Plans as people would make them: of all lengths, on gimbals and arms, with repeats and turns, joints left out."""

from __future__ import annotations

from dataclasses import replace

from .draws import log_uniform
from .effects import CATALOGUE
from .mjcf import Base
from .plan import ALIGNED, SHARES, DrivePlan

MIX = (*4 * ("plain",), *3 * ("many-joints",), *2 * ("short",), *2 * ("turning",), "long")
"""Variants, as often as they are drawn."""
SECONDS = {
    "plain": (12, 61),
    "many-joints": (15, 46),
    "short": (5, 9),
    "turning": (20, 91),
    "long": (300, 601),
}
RATES = {
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


def spread(rng, values, count):
    """Every value equally often (to one), in random order."""
    offset = int(rng.integers(len(values)))
    rows = rng.permutation(count)
    return [values[int(row + offset) % len(values)] for row in rows]


def _variant(wanted, plan, kinds):
    """The wanted variant, or the plain one where the hidden effect makes no sense in it or takes too long."""
    out_of_place = wanted == "turning" and any(kind.cause in SETTLED for kind in kinds)
    slow = any(kind.stiff or kind.base is not Base.FIXED for kind in kinds)
    return "plain" if out_of_place or (wanted == "long" and slow) else wanted


def _axes(rng, variant, arm, plan):
    if variant == "many-joints":
        return int(rng.integers(4, 8))
    return max(plan.axes, int(rng.integers(1, 5))) if arm and variant == "plain" else plan.axes


def _dress(rng, plan, wanted):
    kinds = [CATALOGUE[item.cause] for item in plan.hidden]
    needed = max([kind.needs_axes for kind in kinds], default=1)
    variant = _variant(wanted, plan, kinds)
    arm = variant == "many-joints" or (variant in ("plain", "short") and rng.random() < 0.4)
    idle = ""
    if not plan.trusted and rng.random() >= 0.7:
        idle = str(rng.choice(["held", "unlogged", "bolted"]))
    axes = max(_axes(rng, variant, arm, plan), needed + bool(idle))
    axes = axes if arm else min(axes, 3)
    seconds = float(rng.integers(*SECONDS[variant]))
    again = variant in ("plain", "many-joints", "long") and seconds >= 20.0 and rng.random() < 0.5
    rate = float(rng.choice(RATES[variant]))
    excitation = plan.excitation
    if variant == "long" and excitation not in LONG_MOTIONS:
        excitation = str(rng.choice(LONG_MOTIONS))
    kept = {name: getattr(plan, name) for name in ("seed", "stratum", "data", "trusted")}
    return DrivePlan(
        **kept,
        hidden=tuple(replace(item, share=DRIVE_SHARES[item.share]) for item in plan.hidden),
        axes=axes,
        level="drive",
        rate=rate,
        excitation=excitation,
        seconds=seconds,
        variant=variant,
        arm=arm,
        repeats=int(rng.integers(4, 6)) if again else 1,
        turns=log_uniform(rng, 1.0, 100.0) if variant == "turning" else 0.0,
        idle=idle if axes >= needed + bool(idle) else "",
        camera_off=float(rng.choice([-0.2, 0.0, 0.2])),
        aligned=any(kind.cause in ALIGNED for kind in kinds),
    )


def dressed(rng, plans):
    """The same hidden in logs as people have them."""
    variants = spread(rng, MIX, len(plans))
    return [_dress(rng, *one) for one in zip(plans, variants, strict=True)]
