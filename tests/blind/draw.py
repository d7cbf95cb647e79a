"""A seeded, stratified sample of the factorial: causes and forms × joints × sizes × sensors × rigs × excitations.

Plans come in blocks. Within a block every cause and form of the stratum stands once, and every other factor is spread
evenly over the block; the first plans of a longer sample are those of a shorter one, so that a run can be taken up.
The plans of the drive strata are as people would make them: of all lengths, on gimbals and arms, with repeats and
turns, joints left out."""

from dataclasses import replace

import numpy as np

from .draws import log_uniform
from .effects import CATALOGUE, OUTSIDE, PUBLISHED, TRUSTED
from .excitation import EXCITATIONS
from .logbook import MISMATCHES
from .mjcf import Base
from .plan import ALIGNED, LEVELS, SHARES, STRATA, DrivePlan, Hidden, Plan

RATES = (250.0, 400.0, 500.0, 800.0, 1000.0)
CLEAN_BLOCK = 60

VARIANTS = (*4 * ("plain",), *3 * ("many-joints",), *2 * ("short",), *2 * ("turning",), "long")
"""As often as they are drawn."""
DRIVE_SECONDS = {
    "plain": (12, 61),
    "many-joints": (15, 46),
    "short": (5, 9),
    "turning": (20, 91),
    "long": (300, 601),
}
DRIVE_RATES = {
    "plain": (100.0, 200.0, 250.0, 300.0, 500.0, 1000.0),
    "many-joints": (100.0, 125.0, 250.0, 500.0),
    "short": (200.0, 300.0, 500.0, 1000.0),
    "turning": (200.0, 400.0, 500.0, 1000.0),
    "long": (100.0, 200.0, 250.0),
}
DRIVE_SHARES = dict(zip(SHARES, (0.06, 0.12, 0.2, 0.3, 0.45)))
"""Sizes of effects beside a noise of 1–5 %, for the sizes of the other strata."""
LONG_MOTIONS = ("multisine", "chirp", "staircase")
SETTLED = ("cable-spring", "rubbing-stop", "hysteretic-cable", "friction-spots")
"""Effects of a place in a joint's travel, which a joint that turns on and on does not have."""


def spread(rng, values, count):
    """Every value equally often (to one), in random order."""
    offset = int(rng.integers(len(values)))
    return [values[int(row + offset) % len(values)] for row in rng.permutation(count)]


def _shuffled(rng, plans):
    """The plans in random order."""
    return [plans[i] for i in rng.permutation(len(plans))]


def _forms(kinds):
    """Every form of some causes."""
    return [(kind.cause, form) for kind in kinds for form in (*kind.known, *kind.foreign)]


def _bare(rng, stratum, count):
    """Plans with everything but something hidden."""
    axes = spread(rng, (1, 2, 3, 3), count)
    levels = spread(rng, LEVELS, count)
    excitations = spread(rng, EXCITATIONS, count)
    rates = spread(rng, RATES, count)
    seconds = rng.integers(20, 61, count).astype(float).tolist()
    seeds = rng.integers(2**62, size=count).tolist()
    kept = zip(seeds, axes, levels, excitations, rates, seconds)
    return [Plan(seed, stratum, (), None, *factors) for seed, *factors in kept]


def _hidden(rng, kinds, block):
    """Each form once; over five successive blocks, each at every size."""
    forms = _forms(kinds)
    places = spread(rng, ((np.arange(12) + 0.5) / 12.0).tolist(), len(forms))
    return [
        Hidden(*form, SHARES[(row + block) % len(SHARES)], place)
        for row, (form, place) in enumerate(zip(forms, places))
    ]


def _with(plan, *hidden):
    """The plan with this hidden in it, on a rig with axes enough."""
    needed = max(CATALOGUE[item.cause].needs_axes for item in hidden)
    trusted = plan.trusted or any(item.cause in TRUSTED for item in hidden)
    return replace(plan, hidden=hidden, axes=max(plan.axes, needed), trusted=trusted)


def _clean(rng, stratum):
    """Plans with nothing hidden, one in four on a trusted URDF."""
    plans = _bare(rng, stratum, CLEAN_BLOCK)
    trusted = spread(rng, (False, False, False, True), CLEAN_BLOCK)
    return [replace(plan, trusted=yes) for plan, yes in zip(plans, trusted)]


def _singles(rng, block, stratum, kinds):
    """Every form of some causes once."""
    hidden = _hidden(rng, kinds, block)
    return _shuffled(rng, list(map(_with, _bare(rng, stratum, len(hidden)), hidden)))


def _compatible(first, second):
    """Two different causes, of which one at most holds the base, trusts the URDF, or needs an axis of its own."""
    kinds = CATALOGUE[first.cause], CATALOGUE[second.cause]
    moving = sum(kind.base is not Base.FIXED for kind in kinds)
    trusted = sum(kind.cause in TRUSTED for kind in kinds)
    gearing = sum(kind.stiff for kind in kinds)
    return first.cause != second.cause and moving < 2 and trusted != 1 and gearing < 2


def _partner(rng, first):
    """Something of at least 3 % that may stand beside the first; None where nothing may."""
    place = rng.random()
    share = float(rng.choice(SHARES[2:]))
    others = [Hidden(*form, share, place) for form in _forms(PUBLISHED)]
    ready = [item for item in others if _compatible(first, item)]
    return ready[int(rng.integers(len(ready)))] if ready else None


def _pairs(rng, block):
    """Every published form once, at 1 % or more, each with a random partner."""
    hidden = _hidden(rng, PUBLISHED, block)
    firsts = [replace(item, share=max(item.share, SHARES[1])) for item in hidden]
    bare = _bare(rng, "pair", len(firsts))
    seconds = [_partner(rng, first) for first in firsts]
    return _shuffled(rng, [_with(*one) for one in zip(bare, firsts, seconds) if one[-1]])


def _mismatched(rng):
    """Clean rigs of two axes or more, their torque late and their joints exchanged by turns."""
    plans = _bare(rng, "mismatched", 6 * len(MISMATCHES))
    faults = 6 * list(MISMATCHES)
    return [replace(p, data=data, axes=max(p.axes, 2)) for p, data in zip(plans, faults)]


def _variant(wanted, kinds):
    """The wanted variant, or the plain one where the hidden effect makes no sense in it or takes too long."""
    settled = any(kind.cause in SETTLED for kind in kinds)
    slow = any(kind.stiff or kind.base is not Base.FIXED for kind in kinds)
    unfit = {"turning": settled, "long": slow}
    return "plain" if unfit.get(wanted) else wanted


def _dress(rng, plan, wanted):
    """Return the plan with the rig, the length and the habits of a log that people record."""
    kinds = [CATALOGUE[item.cause] for item in plan.hidden]
    needed = max([kind.needs_axes for kind in kinds], default=1)
    variant = _variant(wanted, kinds)
    arm = variant == "many-joints" or (variant in ("plain", "short") and rng.random() < 0.4)
    idle = ""
    if not plan.trusted and rng.random() >= 0.7:
        idle = str(rng.choice(["held", "unlogged", "bolted"]))
    axes = plan.axes
    if variant == "many-joints":
        axes = int(rng.integers(4, 8))
    elif arm and variant == "plain":
        axes = max(axes, int(rng.integers(1, 5)))
    axes = max(axes, needed + bool(idle))
    axes = axes if arm else min(axes, 3)
    seconds = float(rng.integers(*DRIVE_SECONDS[variant]))
    again = variant in ("plain", "many-joints", "long") and seconds >= 20.0 and rng.random() < 0.5
    rate = float(rng.choice(DRIVE_RATES[variant]))
    excitation = plan.excitation
    if variant == "long" and excitation not in LONG_MOTIONS:
        excitation = str(rng.choice(LONG_MOTIONS))
    return DrivePlan(
        seed=plan.seed,
        stratum=plan.stratum,
        trusted=plan.trusted,
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


def _block(seed, stratum, block):
    """One block of a stratum."""
    rng = np.random.default_rng([seed, STRATA[stratum], block])
    kind = stratum.removeprefix("drive-")
    if kind == "clean":
        plans = _clean(rng, stratum)
    elif kind == "pair":
        plans = _pairs(rng, block)
    elif kind == "mismatched":
        plans = _mismatched(rng)
    else:
        plans = _singles(rng, block, stratum, OUTSIDE if kind == "outside" else PUBLISHED)
    if kind == stratum:
        return plans
    return [_dress(rng, *one) for one in zip(plans, spread(rng, VARIANTS, len(plans)))]


def sample(n, seed, stratum):
    """The first n plans of a stratum (plan.STRATA)."""
    plans = []
    block = 0
    while len(plans) < n:
        plans += _block(seed, stratum, block)
        block += 1
    return plans[:n]
