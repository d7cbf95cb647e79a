"""A seeded, stratified sample of the factorial: causes and forms × joints × sizes × sensors × rigs × excitations.

Plans come in blocks. Within a block every cause and form of the stratum stands once, and every other factor is spread
evenly over the block; the first plans of a longer sample are those of a shorter one, so that a run can be taken up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .corruption import MISMATCHES
from .drive_draw import dressed, spread
from .effects import CATALOGUE, OUTSIDE, PUBLISHED, TRUSTED
from .excitation import EXCITATIONS
from .mjcf import Base
from .plan import LEVELS, SHARES, STRATA, Hidden, Plan

RATES = (250.0, 400.0, 500.0, 800.0, 1000.0)
CLEAN_BLOCK = 60


def _forms(kinds):
    return [(kind.cause, form) for kind in kinds for form in (*kind.known, *kind.foreign)]


def _bare(rng, stratum, count):
    """Plans with everything but something hidden."""
    axes = spread(rng, (1, 2, 3, 3), count)
    levels = spread(rng, LEVELS, count)
    excitations = spread(rng, EXCITATIONS, count)
    rates = spread(rng, RATES, count)
    seconds = rng.integers(20, 61, count)
    seeds = rng.integers(2**62, size=count)
    return [
        Plan(int(seeds[i]), stratum, axes=axes[i], level=levels[i], excitation=excitations[i], rate=rates[i],
             seconds=float(seconds[i]))
        for i in range(count)
    ]  # fmt: skip


def _hidden(rng, forms, block):
    """Each form once; over five successive blocks, each at every size."""
    places = spread(rng, tuple((np.arange(12) + 0.5) / 12.0), len(forms))
    return [
        Hidden(cause, form, SHARES[(row + block) % len(SHARES)], float(place))
        for row, ((cause, form), place) in enumerate(zip(forms, places, strict=True))
    ]


def _with(plan, hidden):
    """The plan with this hidden in it, on a rig with axes enough."""
    needed = max(CATALOGUE[item.cause].needs_axes for item in hidden)
    trusted = plan.trusted or any(item.cause in TRUSTED for item in hidden)
    return replace(plan, hidden=tuple(hidden), axes=max(plan.axes, needed), trusted=trusted)


def _clean(rng, stratum):
    plans = _bare(rng, stratum, CLEAN_BLOCK)
    trusted = spread(rng, (False, False, False, True), CLEAN_BLOCK)
    return [replace(plan, trusted=yes) for plan, yes in zip(plans, trusted, strict=True)]


def _singles(rng, block, stratum, kinds):
    hidden = _hidden(rng, _forms(kinds), block)
    plans = [
        _with(plan, [item])
        for plan, item in zip(_bare(rng, stratum, len(hidden)), hidden, strict=True)
    ]
    return [plans[i] for i in rng.permutation(len(plans))]


def _compatible(first, second):
    """Two different causes, of which one at most holds the base, trusts the URDF, or needs an axis of its own."""
    kinds = CATALOGUE[first.cause], CATALOGUE[second.cause]
    moving = sum(kind.base is not Base.FIXED for kind in kinds)
    trusted = sum(item.cause in TRUSTED for item in (first, second))
    gearing = sum(kind.stiff for kind in kinds)
    return first.cause != second.cause and moving < 2 and trusted != 1 and gearing < 2


def _partner(rng, first):
    """Something of at least 3 % that may stand beside the first; None where nothing may."""
    joint = rng.random()
    share = float(rng.choice(SHARES[2:]))
    ready = [
        item
        for item in (Hidden(*form, share, joint) for form in _forms(PUBLISHED))
        if _compatible(first, item)
    ]
    return ready[int(rng.integers(len(ready)))] if ready else None


def _pairs(rng, block):
    """Every published form once, at 1 % or more, each with a random partner."""
    firsts = [
        replace(item, share=max(item.share, SHARES[1]))
        for item in _hidden(rng, _forms(PUBLISHED), block)
    ]
    bare = _bare(rng, "pair", len(firsts))
    seconds = [_partner(rng, first) for first in firsts]
    plans = [
        _with(p, [a, b]) for p, a, b in zip(bare, firsts, seconds, strict=True) if b is not None
    ]
    return [plans[i] for i in rng.permutation(len(plans))]


def _mismatched(rng):
    """Clean rigs of two axes or more, their torque late and their joints exchanged by turns."""
    faults = list(MISMATCHES)
    plans = _bare(rng, "mismatched", 6 * len(faults))
    return [
        replace(p, data=faults[i % len(faults)], axes=max(p.axes, 2)) for i, p in enumerate(plans)
    ]


def _block(seed, stratum, block):
    rng = np.random.default_rng([seed, STRATA[stratum], block])
    makers = {
        "clean": lambda: _clean(rng, stratum),
        "single": lambda: _singles(rng, block, "single", PUBLISHED),
        "outside": lambda: _singles(rng, block, "outside", OUTSIDE),
        "pair": lambda: _pairs(rng, block),
        "mismatched": lambda: _mismatched(rng),
        "drive-clean": lambda: dressed(rng, _clean(rng, stratum)),
        "drive-single": lambda: dressed(rng, _singles(rng, block, stratum, PUBLISHED)),
    }
    return makers[stratum]()


def sample(n, seed, stratum):
    """The first n plans of a stratum (plan.STRATA)."""
    plans = []
    block = 0
    while len(plans) < n:
        plans += _block(seed, stratum, block)
        block += 1
    return plans[:n]
