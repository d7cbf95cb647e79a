"""Jitter of the model-based controller with models that are wrong on purpose, beside the PID's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import degrees, inf, isfinite

import numpy as np
from tqdm import tqdm

from gimbal_pin.control.controller_names import BASELINE
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.uncertainty import change_parameters, columns, estimate
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import (
    draw_profile,
    learn_recipe,
    simulate_shaken_log,
    unbalance_payload,
)
from gimbal_pin.pointing.measurement import Station
from gimbal_pin.pointing.pointer import Pointer
from gimbal_pin.pointing.recipe import SAMPLES, Recipe
from gimbal_pin.pointing.run import simulate_holding
from gimbal_pin.pointing.sight import Sight, holding
from gimbal_pin.rig.rig import Rig


def doubtful(model: Model, wanted: Array, platform: Platform) -> Array | None:
    """Return the change of parameters, one standard deviation long, that changes the torque most along a motion.

    ``P = L Lᵀ``: L times the eigenvector of ``Lᵀ mean(Yᵀ Y) L`` with the largest eigenvalue. None without covariance.
    """
    known = estimate(model)
    if known is None:
        return None
    part = platform.part(slice(None, None, max(1, len(platform) // SAMPLES)))
    held = holding(Sight(model.rig), wanted, part)
    Y = columns(model, known[1], held.q, held.v, held.a, part)
    power, size = np.linalg.eigh(known[0].covariance)
    L = size * np.sqrt(np.maximum(power, 0.0))
    seen = L.T @ np.einsum("njk,njl->kl", Y, Y) @ L / len(Y)
    return np.asarray(L @ np.linalg.eigh(seen)[1][:, -1])


SHARES = (-0.3, -0.15, 0.0, 0.15, 0.3)
"""Errors of every body's mass, moments and inertia."""
DEVIATIONS = (-3.0, 3.0)
"""Errors along what the log left most uncertain, in standard deviations."""
SECONDS = 3.0
"""Length of a run, s."""


@dataclass(frozen=True)
class Sweep:
    """Jitter of ours with models that are wrong on purpose, beside the world-frame PID's, all on one motion.

    Attributes:
        scaled: Error of all masses, moments and inertias, as a share → jitter, rad rms; inf where the loop diverged.
        uncertain: Error in standard deviations along the most uncertain way → the same; empty without a covariance.
        pid: The world-frame PID's jitter, rad rms.
    """

    scaled: Mapping[float, float]
    uncertain: Mapping[float, float]
    pid: float

    @property
    def safer(self) -> tuple[float | None, float | None]:
        """Errors below and above which the PID holds the camera stiller, as shares; None: at none that was tried."""
        errors = sorted(self.scaled)
        low, high = ([error for error in errors if sign * error >= 0] for sign in (-1, 1))
        return self.crossing(low[::-1]), self.crossing(high)

    def crossing(self, errors: Sequence[float]) -> float | None:
        """Where jitter first rises above the PID's on the way through some errors, by the chord between two of them."""
        for before, after in pairwise(errors):
            a = self.scaled[before]
            b = self.scaled[after]
            if a > self.pid:
                return before
            if b > self.pid:
                return before + (after - before) * (
                    (self.pid - a) / (b - a) if isfinite(b) else 1.0
                )
        return None

    @property
    def sentence(self) -> str:
        """What it says, in one sentence."""
        below, above = self.safer
        if self.scaled[0.0] > self.pid:
            return "here a PID is safer even with a model that is right"
        sides = [f"{100 * edge:+.0f} %" for edge in (below, above) if edge is not None]
        tried = 100 * max(abs(error) for error in self.scaled)
        if not sides:
            return f"with all masses and inertias up to {tried:.0f} % wrong, the model still does better than a PID"
        return f"a PID is safer with masses and inertias more than {' or '.join(sides)} wrong"


def sweep(plant: Model, platform: Platform, recipe: Recipe) -> Sweep:
    """Hold the camera with models that are wrong on purpose, on one motion."""
    ours = recipe.pointer()
    model = recipe.model
    way = doubtful(model, recipe.wanted, platform)
    models = {("scaled", share): model if share == 0 else heavier(model, share) for share in SHARES}
    if way is not None:
        models |= {("uncertain", size): change_parameters(model, size * way) for size in DEVIATIONS}
    found: dict[str, dict[float, float]] = {"scaled": {}, "uncertain": {}}
    bar = tqdm(models.items(), "jitter against model error", unit="run", disable=None, leave=False)
    for (kind, error), wrong in bar:
        law = replace(ours.law, model=wrong) if isinstance(ours.law, CarriedTorque) else ours.law
        found[kind][error] = held_jitter(plant, platform, replace(ours, law=law))
    return Sweep(**found, pid=held_jitter(plant, platform, recipe.pointer(BASELINE)))


def held_jitter(plant: Model, platform: Platform, pointer: Pointer) -> float:
    """Jitter of a run, rad rms; inf for a loop that diverges."""
    try:
        return simulate_holding(
            plant, pointer, platform, rng=np.random.default_rng(1), seconds=SECONDS
        ).jitter[0]
    except UsageError:
        return inf


def heavier(model: Model, share: float) -> Model:
    """Return the model with every mass, first moment and inertia more by a share; friction stays."""
    return replace(model, rig=model.rig.with_phi(model.rig.phi * (1 + share)))


def main(rig: str, payload: str | None = None) -> None:
    """Print jitter against the error of the model that a simulated shaken log of 60 s gives.

    Args:
        rig: A rig.
        payload: Its payload.
    """
    loaded = Rig.load(rig, payload)
    plant = nominal(unbalance_payload(loaded))
    recipe = learn_recipe(loaded, simulate_shaken_log(plant), Station.of(loaded))
    found = sweep(plant, draw_profile(loaded, SECONDS, 0), recipe)
    print(f"PID: {degrees(found.pid):.5f} deg rms")
    for share, size in sorted(found.scaled.items()):
        print(f"masses and inertias {100 * share:+.0f} %: {degrees(size):.5f} deg rms")
    for deviations, size in sorted(found.uncertain.items()):
        print(f"least certain {deviations:+g} standard deviations: {degrees(size):.5f} deg rms")
    print(found.sentence)
