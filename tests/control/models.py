"""Models for controllers: free of all but their bodies, or known to a stated covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.dynamics import Estimated, Model, nominal, plant_with, reduce_parameters
from gimbal_pin.effects import ActuatorLag, parse_effect
from gimbal_pin.log import Array
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig import Limits, Motor
from tests.rigs import bundled


def free(name: str) -> Model:
    """Return a bundled rig weightless, unlimited and without friction: small errors see the linear loop alone."""
    rig = bundled(name)
    model = rig.model.copy()
    model.gravity.linear = np.zeros(3)
    bare = replace(rig, model=model, motors=(Motor(),) * rig.n, limits=(Limits(),) * rig.n)
    return Model(bare, ())


def name_parameters(model: Model) -> tuple[str, ...]:
    """Return the names of the base parameters, then of the terms' coefficients."""
    terms = (
        f"{term.effect.joint}.{coefficient.name}"
        for term in model.terms
        for coefficient in term.effect.coefficients
    )
    return (*reduce_parameters(model.rig).base_names, *terms)


def estimated(model: Model, covariance: Array) -> Model:
    """Return the model with a covariance of its parameters, (k, k)."""
    names = name_parameters(model)
    known = Estimated(names, ("",) * len(names), np.zeros(len(names)), covariance)
    return replace(model, estimated=known)


def doubtful(share: float) -> Model:
    """Return the turret with a rotor at pan, its bodies known to a share of their size; tilt's drive lags."""
    rig = bundled("turret")
    model = plant_with(nominal(rig), [parse_effect("armature:pan:inertia=0.01", rig)]).plant
    size = np.abs(model.rig.phi[find_base_columns(model.rig, reduce_parameters(model.rig))])
    std = np.zeros(len(name_parameters(model)))
    std[: len(size)] = share * size
    covariance = 0.5 * (np.outer(std, std) + np.diag(std**2))
    return replace(estimated(model, covariance), drive=(ActuatorLag("tilt", 0.002),))
