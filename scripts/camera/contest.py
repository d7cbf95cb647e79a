"""What each thing that a controller knows takes off the PID's jitter: eleven controllers of equal margins.

Each from "without-hidden" to "computed-torque" knows all that the one before it does; the last two stand on top of
that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import Any

import numpy as np

from gimbal_pin.control.controllers import BASELINE, OURS
from gimbal_pin.control.laws import ComputedTorque, bounds
from gimbal_pin.control.laws.base import Carried, Pid
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.control.laws.computed_torque import Robust, lyapunov, stiffened
from gimbal_pin.control.laws.design import LAYERED, bisected
from gimbal_pin.control.laws.equal import DAMPING, INTEGRAL, Equal, bandwidth
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import name_columns
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import draw_profile, learn_recipe, simulate_shaken_log, unbalance_payload
from gimbal_pin.pointing.measurement import Measurement, Station
from gimbal_pin.pointing.navigator import Navigator
from gimbal_pin.pointing.pointer import Holder, Pointer
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.result import Row
from gimbal_pin.pointing.run import simulate_holding
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Foretold:
    """A controller that is told the platform's true motion where each drive's torque will act: no forecast beats it."""

    pointer: Pointer
    platform: Platform

    @property
    def navigator(self) -> Navigator:
        """Tells what is wanted."""
        return self.pointer.navigator

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return self.pointer.dt

    def start(self, seen: Measurement, camera: Array, base: Array) -> Any:
        """Return the memory at the first sample."""
        return self.pointer.start(seen, camera, base)

    def torque(self, seen: Measurement, memory: Any) -> tuple[Array, Any]:
        """Return torque, N m, and the next memory, by the mean of the motion over each hold (Simpson's rule)."""
        true = []
        for lead in self.navigator.forecast.leads:
            now = self.platform.at(np.clip(seen.t + lead + self.dt / 2 * np.arange(-1, 2), 0.0, self.platform.t[-1]))
            true.append(Carried(*(np.array([1, 4, 1]) / 6 @ x for x in (now.f, now.w, now.dw))))
        return self.pointer.torque(seen._replace(true=tuple(true)), memory)


def foretell(recipe: Recipe, platform: Platform) -> Foretold:
    """Return computed torque to which a motion is foreknown."""
    ours = recipe.pointer()
    return Foretold(replace(ours, navigator=replace(ours.navigator, oracle=True)), platform)


def without_hidden(model: Model) -> Model:
    """Return the model with what only a moving base shows dropped: the least moments that give the same on a fixed one.

    ``min ‖φ'‖`` over first and second moments with ``M φ' = M φ``, M the mixing of a fixed base; masses stay.
    """
    rig = model.rig
    names, places = name_columns(rig)
    mixing, phi = reduce_parameters(rig, base="fixed").mixing, rig.phi
    free = np.array([not name.endswith(".m") for name in names])
    left = mixing @ phi[places] - mixing[:, ~free] @ phi[places[~free]]
    phi[places[free]] = np.linalg.pinv(mixing[:, free]) @ left
    return replace(model, rig=rig.with_phi(phi))


def redesign(law: CarriedTorque, equals: Sequence[Equal]) -> CarriedTorque:
    """Return slower loops with Lyapunov redesign, of the thinnest layer that keeps every joint's margin."""
    slow = tuple(Pid.placed(LAYERED * bandwidth(equal.pid), DAMPING, INTEGRAL) for equal in equals)
    layer = Robust(lyapunov(slow), bounds(law.model, np.random.default_rng(0)), 1.0)

    def enough(gain: float) -> bool:
        rows = zip(equals, slow, layer.rows)
        return all(equal.fair(equal.of(stiffened(pid, row, gain))) for equal, pid, row in rows)

    return replace(law, gains=slow, robust=replace(layer, gain=bisected(enough, 1e-3, 100.0)))


def make_controllers(recipe: Recipe, platform: Platform) -> dict[str, Callable[[], Holder]]:
    """Return name → what makes the controller, the one that knows least first."""
    pid, model, gains = recipe.pointer(BASELINE), recipe.model, tuple(own.pid for own in recipe.equals)
    blind = replace(recipe.navigator(gains, False), accelerates=True)
    seeing = recipe.pointer()
    law = replace(seeing.law, trusted=())  # type: ignore[type-var]
    assert isinstance(law, CarriedTorque)
    bare = replace(law, model=replace(model, terms=()))
    fixed = ComputedTorque(replace(model, terms=()), gains, recipe.dt)

    foresees = replace(seeing.navigator, fusion=None)
    return {
        "pid-joint": lambda: replace(pid, navigator=replace(pid.navigator, by_platform=True)),
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
    rig: str, payload: str | None = None, names: tuple[str, ...] = (), seeds: int = 1, seconds: float = 10.0
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
    plant, station = nominal(unbalance_payload(loaded)), Station.of(loaded)
    recipe = learn_recipe(loaded, simulate_shaken_log(plant), station)
    runs: dict[str, list[Any]] = {}
    for seed in range(seeds):
        platform = draw_profile(loaded, seconds, seed)
        for name, make in make_controllers(recipe, platform).items():
            if name in (names or (name,)):
                rng = np.random.default_rng([seed, 1])
                run = simulate_holding(plant, make(), platform, rng=rng, seconds=seconds, station=station, name=name)
                runs.setdefault(name, []).append(run)
    rows = [Row(name, tuple(own)) for name, own in runs.items()]
    whole = next((row.jitter_rms for row in rows if row.controller == BASELINE), rows[0].jitter_rms)
    print(f"{'controller':18} jitter rms   largest     drift, deg   of the PID's mean square")
    for row in rows:
        sizes = " ".join(f"{degrees(x):10.5f}" for x in (row.jitter_rms, row.jitter_max, row.drift))
        print(f"{row.controller:18}{sizes}   {100 * (row.jitter_rms / whole) ** 2:10.2f} %")
