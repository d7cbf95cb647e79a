"""How probable a cause is beside another: after logs, and after one that is yet to come."""

from __future__ import annotations

from math import pi, sqrt

from scipy.stats import norm

from gimbal_pin.log.log import Array

SURE = 0.95
"""Probability from which a cause is named."""
LISTED = 0.86
"""Probability that what is there has one of the forms that were fitted, a factor of every stated probability: of the 67
findings of over 70 % on the logs of two draws of ``scripts/blind``, which were diagnosed with .8, 58 were right."""
LUCKY = float(norm.ppf(SURE))
"""Deviations of the noise by which one log of twenty is less telling."""


def moderate(delta: float, std: float) -> float:
    """``δ/√(1 + π s²/8)``: log odds where a difference of log likelihoods is known to a deviation of s.

    The logistic function averaged over it (MacKay, Neural Computation 4, 1992): no model is the truth, and a few blocks
    may tell most.
    """
    return delta / sqrt(1 + pi / 8 * std**2)


def foresee_log_odds(power: Array, delta: float, known: float = 0.0, luck: float = LUCKY) -> float:
    """Return the log odds of a cause over a rival that a log is expected to give, if the cause is there.

    ``δ' = δ + g/2 - z√g``, ``g = Σp - known``, moderated by ``s² = Σp + B var(p)/4``.

    Args:
        power: p: power of what the rival leaves of the cause's torque, in units of the noise, in each block, (B,).
        delta: δ: difference of the log likelihoods without that log.
        known: What of `power` is of logs that δ holds already.
        luck: z: deviations of the noise that are taken off; by default δ' is more in 19 of 20 logs, with 0 in half.
    """
    total = float(power.sum())
    gain = max(total - known, 0.0)
    return moderate(
        delta + gain / 2 - luck * sqrt(gain),
        sqrt(total + len(power) * float(power.var(ddof=1)) / 4),
    )
