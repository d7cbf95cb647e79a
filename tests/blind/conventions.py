"""Where a truth's parameter and a diagnosis's say the same in other words: name, factor and shift. Data only."""

from __future__ import annotations

from typing import NamedTuple


class Reading(NamedTuple):
    """``truth = factor · value + shift`` for the diagnosis's parameter of this name."""

    name: str
    factor: float = 1.0
    shift: float = 0.0


PARTS = {
    ("position-dependent-friction", "two-harmonics", "amplitude"): Reading("amplitude", 1.25),
    ("torque-ripple", "two", "depth"): Reading("amplitude", 1.25),
    ("cogging", "several", "amplitude"): None,
}
"""(cause, form, parameter) → the same for one form alone; None where the two do not compare."""
READINGS = {
    ("asymmetric-friction", "coulomb_difference"): Reading("coulomb", 2.0),
    ("asymmetric-friction", "viscous_difference"): Reading("viscous", 2.0),
    ("load-dependent-friction", "ratio"): Reading("mu"),
    ("quadratic-drag", "coefficient"): Reading("drag"),
    ("torque-ripple", "depth"): Reading("amplitude"),
    ("torque-gain", "gain"): Reading("gain", 1.0, -1.0),
    ("torque-bias", "bias"): Reading("bias", -1.0),
    ("delay", "delay"): Reading("time"),
    ("joint-flexibility", "resonance_hz"): Reading("frequency"),
}
"""(cause, the truth's parameter) → the diagnosis's; where nothing stands the names and meanings agree."""
LOOK_ALIKES = (
    frozenset({"delay", "actuator-lag"}),
    frozenset({"torque-bias", "asymmetric-friction"}),
)
"""Causes that are one to first order: τ(t - d) ≈ τ - d τ' as of a lag of d; and F₊ v > 0, -F₋ v < 0, which is
½(F₊ + F₋) sign v + ½(F₊ - F₋), a constant. Their probabilities are judged together."""
COMPANY = {("cogging", "steep"): "torque-bias"}
"""(cause, form) → what the form brings along besides: cos(x + 0.45 sin x) has a mean of its own, -J₁(0.45)."""
