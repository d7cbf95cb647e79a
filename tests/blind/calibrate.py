"""Make an effect as strong as wanted: trial runs, and a secant in the logarithm of its strength."""

from __future__ import annotations

from math import exp, log

import numpy as np

from .ledger import settle
from .plant import PlantDivergedError
from .scene import STIFF_TRIAL_STEP, TRIAL_STEP
from .visibility import blocks, rms, smooth

TRIALS = 6
CLOSE_ENOUGH = 0.15
LONGEST_LEAP = log(100.0)
LARGEST = log(1e6)


def share_of(effect, ledger, rate):
    """Effect rms over torque rms on the effect's own joint, or the largest share where it has none."""
    size = rms(smooth(blocks(ledger.effect, rate), rate)) if effect.in_band else rms(ledger.effect)
    each = size / np.maximum(rms(ledger.command), 1e-9)
    return float(each.max() if effect.joint is None else each[effect.joint])


def trial(scene, effect):
    """A run at coarse steps with this effect alone."""
    world, trace = scene.run(
        [effect], scene.substeps(STIFF_TRIAL_STEP if effect.stiff else TRIAL_STEP)
    )
    return world, settle(world, trace)


def _tried(scene, effect):
    """The share that it reaches, or nothing if the loop runs away with it."""
    try:
        return share_of(effect, trial(scene, effect)[1], scene.rate)
    except PlantDivergedError:
        return None


def _next(k, error, tried, top):
    """Where to try next: between the nearest weaker and stronger trial, or a leap as the last slope says."""
    weaker = max((x for x, e in tried if e > 0.0), default=None)
    stronger = min((x for x, e in tried if e <= 0.0), default=top if top < LARGEST else None)
    if weaker is not None and stronger is not None and weaker < stronger:
        known = dict(tried)
        low = known[weaker]
        high = known.get(stronger, -1.0)
        return weaker + (stronger - weaker) * min(max(low / (low - high), 0.15), 0.85)
    slope = 1.0
    if len(tried) > 1 and abs(k - tried[-2][0]) > 1e-3:
        slope = min(max((tried[-2][1] - error) / (k - tried[-2][0]), 0.15), 3.0)
    return k + min(max(error / slope, -LONGEST_LEAP), LONGEST_LEAP)


def calibrate(scene, effect, wanted):
    """The effect scaled until its raw rms is about `wanted` of the torque rms; the nearest found if it cannot be.

    Raises: PlantDivergedError when the loop runs away at every strength tried."""
    k = 0.0
    top = log(effect.widest)
    tried = list[tuple[float, float]]()
    for _ in range(TRIALS):
        share = _tried(scene, effect.scaled(exp(k)))
        if share is None:
            top = k
            k = k - log(4.0) if not tried else 0.5 * (k + tried[-1][0])
            continue
        error = log(wanted / max(share, 1e-9))
        tried.append((k, error))
        following = min(_next(k, error, tried, top), top)
        if abs(error) < CLOSE_ENOUGH or abs(following - k) < 1e-3:
            break
        k = following
    if not tried:
        raise PlantDivergedError(f"{effect.cause}: no strength that this loop can hold")
    return effect.scaled(exp(min(tried, key=lambda pair: abs(pair[1]))[0]))
