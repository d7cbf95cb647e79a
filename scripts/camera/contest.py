"""What each thing that a controller knows takes off the PID's jitter: ten controllers of equal margins.

Each from "without-hidden" to "computed-torque" knows all that the one before it does; the last two stand on top of
that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import Any

import numpy as np

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.control.laws import ComputedTorque, bounds
from gimbal_pin.control.laws.base import BaseState, Pid
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.computed_torque import Robust, lyapunov, stiffened
from gimbal_pin.control.laws.design import LAYERED, bisected
from gimbal_pin.control.laws.equal_margin import (
    OUTER_DAMPING,
    OUTER_INTEGRAL,
    EqualMarginLoop,
    bandwidth,
)
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import (
    draw_profile,
    learn_recipe,
    simulate_shaken_log,
    unbalance_payload,
)
from gimbal_pin.pointing.forecast import Forecast, Past
from gimbal_pin.pointing.measurement import Station
from gimbal_pin.pointing.pointer import Holder, Pointer
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.result import Row
from gimbal_pin.pointing.run import simulate_holding
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Foreknowledge(Forecast):
    """The platform's true motion where each drive's torque will act, in place of a forecast: none beats it."""

    platform: Platform | None = None

    def ahead(self, past: Past) -> list[BaseState]:
        """Return the mean of the motion over the hold of each lead (Simpson's rule)."""
        assert self.platform is not None
        true = []
        t = (past.samples - 1) * self.dt
        for lead in self.leads:
            now = self.platform.at(
                np.clip(t + lead + self.dt / 2 * np.arange(-1, 2), 0.0, self.platform.t[-1])
            )
            true.append(BaseState(*(np.array([1, 4, 1]) / 6 @ x for x in (now.f, now.w, now.dw))))
        return true


def foretell(recipe: Recipe, platform: Platform) -> Pointer:
    """Return computed torque to which a motion is foreknown."""
    ours = recipe.pointer()
    own = ours.navigator.forecast
    known = Foreknowledge(own.spectrum, own.gains, own.dt, own.leads, False, platform)
    return replace(ours, navigator=replace(ours.navigator, forecast=known))


def without_hidden(model: Model) -> Model:
    """Return the model with what only a moving base shows dropped: the least moments that give the same on a fixed one.

    ``min ‖φ'‖`` over first and second moments with ``M φ' = M φ``, M the mixing of a fixed base; masses stay.
    """
    rig = model.rig
    names, places = name_columns(rig)
    mixing = reduce_parameters(rig, base="fixed").mixing
    phi = rig.phi
    free = np.array([not name.endswith(".m") for name in names])
    left = mixing @ phi[places] - mixing[:, ~free] @ phi[places[~free]]
    phi[places[free]] = np.linalg.pinv(mixing[:, free]) @ left
    return replace(model, rig=rig.with_phi(phi))


def redesign(law: CarriedTorque, equals: Sequence[EqualMarginLoop]) -> CarriedTorque:
    """Return slower loops with Lyapunov redesign, of the thinnest layer that keeps every joint's margin."""
    slow = tuple(
        Pid.placed(LAYERED * bandwidth(equal.pid), OUTER_DAMPING, OUTER_INTEGRAL)
        for equal in equals
    )
    layer = Robust(lyapunov(slow), bounds(law.model, np.random.default_rng(0)), 1.0)

    def enough(gain: float) -> bool:
        rows = zip(equals, slow, layer.rows)
        return all(equal.fair(equal.of(stiffened(pid, row, gain))) for equal, pid, row in rows)

    return replace(law, gains=slow, robust=replace(layer, gain=bisected(enough, 1e-3, 100.0)))


def make_controllers(recipe: Recipe, platform: Platform) -> dict[str, Callable[[], Holder]]:
    """Return name → what makes the controller, the one that knows least first."""
    pid = recipe.pointer(BASELINE)
    model = recipe.model
    gains = tuple(own.pid for own in recipe.equals)
    blind = replace(recipe.navigator(gains, False), accelerates=True)
    seeing = recipe.pointer()
    law = replace(seeing.law, trusted=())  # type: ignore[type-var]
    assert isinstance(law, CarriedTorque)
    bare = replace(law, model=replace(model, terms=()))
    fixed = ComputedTorque(replace(model, terms=()), gains, recipe.dt)

    foresees = replace(seeing.navigator, fusion=None)
    return {
        BASELINE: lambda: pid,
        "fixed-base": lambda: replace(pid, law=fixed),
        "without-hidden": lambda: replace(pid, navigator=blind, law=replace(bare, model=without_hidden(bare.model))),
        "moving-base": lambda: replace(pid, navigator=blind, law=bare),
        "with-friction": lambda: replace(pid, navigator=blind, law=law),
        "with-forecast": lambda: replace(pid, navigator=foresees, law=law),
        "with-gyros": lambda: replace(pid, navigator=seeing.navigator, law=law),
        OURS: lambda: seeing,
        "lyapunov": lambda: replace(seeing, law=redesign(law, recipe.equals)),
        "foreknown": lambda: foretell(recipe, platform),
    }  # fmt: skip


def main(
    rig: str,
    payload: str | None = None,
    names: tuple[str, ...] = (),
    seeds: int = 1,
    seconds: float = 10.0,
) -> None:
    """Print jitter, drift and torque of every controller on profile S, and its share of the PID's mean square error.

    Args:
        rig: A rig.
        payload: Its payload.
        names: Controllers; none: all.
        seeds: Runs of each.
        seconds: Length of a run, s.
    """
    loaded = Rig.load(rig, payload)
    plant = nominal(unbalance_payload(loaded))
    station = Station.of(loaded)
    recipe = learn_recipe(loaded, simulate_shaken_log(plant), station)
    runs: dict[str, list[Any]] = {}
    for seed in range(seeds):
        platform = draw_profile(loaded, seconds, seed)
        for name, make in make_controllers(recipe, platform).items():
            if name in (names or (name,)):
                rng = np.random.default_rng([seed, 1])
                run = simulate_holding(
                    plant, make(), platform, rng=rng, seconds=seconds, station=station, name=name
                )
                runs.setdefault(name, []).append(run)
    rows = [Row(name, tuple(own)) for name, own in runs.items()]
    whole = next((row.jitter_rms for row in rows if row.controller == BASELINE), rows[0].jitter_rms)
    print(f"{'controller':18} jitter rms   largest     drift, deg   of the PID's mean square")
    for row in rows:
        sizes = " ".join(f"{degrees(x):10.5f}" for x in (row.jitter_rms, row.jitter_max, row.drift))
        print(f"{row.controller:18}{sizes}   {100 * (row.jitter_rms / whole) ** 2:10.2f} %")
