"""Runs of one rig of a Monte Carlo study, a step of all axes or a camera held still, and their figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import inf, isnan, radians

import numpy as np

from gimbal_pin.control.laws.design import Wish
from gimbal_pin.control.tracking import track
from gimbal_pin.control.tuning import StoredController, TunedLaw, Tuning, tune
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import GimbalPinError, UsageError
from gimbal_pin.fleet.executor import Value
from gimbal_pin.fleet.variation import RigDraw, Variation
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.bench import WANTED, draw_profile, learn_recipe
from gimbal_pin.pointing.measurement import Station
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.result import SETTLING, SHORTEST_DRIFT, SHORTEST_JITTER
from gimbal_pin.pointing.run import simulate_holding
from gimbal_pin.pointing.sight import unable
from gimbal_pin.rig.reading import parse_decimal
from gimbal_pin.rig.rig import Rig

STEPS = {"rms_error": "°", "overshoot_percent": "%", "settling_time": "s", "peak_torque": ""}
"""Figures of a step and their units in reports (none: a share of the limit), of each joint and the largest of all."""
PLATFORM = {"jitter": "°", "jitter_max": "°", "drift": "°", "peak_torque": ""}
"""Figures of a camera on profile S and their units; the torque is also that of each joint."""
SCALES = {"°": radians(1.0), "mm": 1e-3, "%": 1.0, "s": 1.0, "": 1.0}
"""Unit in reports and requirements → its size in the unit of the table."""
SHORTEST_HOLDING = SETTLING + SHORTEST_JITTER
"""Shortest run that holds a camera, s: its start does not count, and the rest must show jitter."""
SHORTEST_DRIFTING = SETTLING + SHORTEST_DRIFT
"""Shortest run that shows how a camera drifts, s."""


@dataclass(frozen=True)
class Limit:
    """Requirement that a figure stays below a bound, in rad, s, per cent or as a share; `text` as it was stated."""

    figure: str
    bound: float
    text: str


def parse_limit(text: str, known: Mapping[str, str]) -> Limit:
    """Return the requirement ``FIGURE < NUMBER``, in the unit of the figure in `known`.

    Raises:
        UsageError: It is none, or of another figure.
    """
    figure, _, number = (part.strip() for part in text.partition("<"))
    unit = known.get(figure, "")
    bound = parse_decimal(number.removesuffix(unit).strip())
    if figure not in known or not bound or bound < 0:
        what = (
            f"states no positive number of {unit or 'a share'}"
            if figure in known
            else "names no figure of these runs"
        )
        raise UsageError(
            f"--spec '{text}'", what, f"write FIGURE < NUMBER with one of {', '.join(known)}"
        )
    return Limit(figure, bound * SCALES[unit], text)


def list_figures(rig: Rig, platform: bool) -> dict[str, str]:
    """Return the names of the figures and their units in reports.

    Where some joints slide and some turn, there is no largest error of all.
    """
    if platform:
        return PLATFORM | {f"peak_torque_{joint}": "" for joint in rig.joints}
    each = dict[str, str]()
    largest = dict[str, str]()
    for name, unit in STEPS.items():
        for joint, slides in zip(rig.joints, rig.slides):
            each[f"{name}_{joint}"] = "mm" if slides and unit == "°" else unit
            largest[name] = each[f"{name}_{joint}"]
    if len({*rig.slides}) > 1:
        del largest["rms_error"]
    return largest | each


@dataclass(frozen=True, eq=False)
class Study:
    """Run of every rig.

    Attributes:
        variation: The rigs.
        wish: Specification of the controller.
        law: The controller; None: tuned anew for each rig.
        seconds: Length of a run, s.
        recipe: Controller that holds a camera on profile S; None: the rig steps on a base that stands.
    """

    variation: Variation
    wish: Wish
    law: TunedLaw | None
    seconds: float
    recipe: Recipe | None = None

    def describe(self) -> dict[str, object]:
        """Return all that the results depend on."""
        model = self.variation.model
        law = self.law
        known = self.variation.estimated
        return {
            "rig": model.rig.name,
            "model": [
                describe_rig(model.rig),
                model.to_dict(),
                known and known.covariance.tolist(),
            ],
            "controller": [vars(self.wish), law and [law.gains, repr(vars(law).get("robust"))]],
            "believed": getattr(law, "model", model).to_dict(),
            "seconds": self.seconds,
            "platform": self.recipe is not None,
            "vary": asdict(self.variation.vary),
        }

    def run(self, rig: RigDraw) -> dict[str, Value]:
        """Return a rig's inputs and figures, or its inputs and why no such rig can exist or be simulated."""
        values = self.variation.choose_values(rig.probabilities)
        row: dict[str, Value] = {name: values[name] for name in self.variation.inputs}
        try:
            body = self.variation.make_body(values)
            plant = self.variation.make_plant(body, values)
            law = self.law or tune(body, **vars(self.wish)).controller
            if self.recipe is None:
                return row | self.simulate_step(law, plant, rig.seed)
            recipe = (
                self.recipe
                if self.law
                else replace(self.recipe, model=body, law=self.recipe.law and law)
            )
            return row | self.hold_camera(recipe, plant, rig.seed)
        except GimbalPinError as error:
            return row | {"error": str(error)}

    def simulate_step(self, law: TunedLaw, plant: Model, seed: int) -> dict[str, float]:
        """Return the figures of a step of all axes: of no overshoot 0, of a joint that did not settle infinite."""
        rng = np.random.default_rng([seed, 2])
        delay = self.wish.samples
        steps = track(
            plant, {"own": law}, rng=rng, seconds=self.seconds, delay=delay, one_by_one=False
        ).experiments[0]
        figures = compute_torque_shares(plant.rig, np.asarray(steps.log.tau))
        for joint, metrics in steps.joints.items():
            stays = isnan(metrics.overshoot_percent)
            settling = inf if isnan(metrics.settling_time) else metrics.settling_time
            figures[f"rms_error_{joint}"] = metrics.rms_error
            figures[f"overshoot_percent_{joint}"] = 0.0 if stays else metrics.overshoot_percent
            figures[f"settling_time_{joint}"] = 0.0 if stays else settling
        largest = {
            name: max(figures[f"{name}_{joint}"] for joint in plant.rig.joints) for name in STEPS
        }
        return {
            name: {**largest, **figures}[name] for name in list_figures(plant.rig, platform=False)
        }

    def hold_camera(self, recipe: Recipe, plant: Model, seed: int) -> dict[str, float]:
        """Return the figures of a camera held on profile S."""
        holder = recipe.pointer(recipe.kind)
        ground = draw_profile(plant.rig, self.seconds, seed, holder.dt)
        rng = np.random.default_rng([seed, 2])
        run = simulate_holding(
            plant, holder, ground, rng=rng, seconds=self.seconds, delay=self.wish.samples
        )
        shares = compute_torque_shares(plant.rig, np.asarray(run.tau)[run.counted])
        return {**dict(zip(PLATFORM, (*run.jitter, max(shares.values())))), **shares}


def compute_torque_shares(rig: Rig, tau: Array) -> dict[str, float]:
    """Return ``peak_torque_JOINT`` → largest torque as a share of its motor's limit."""
    peaks: list[float] = (np.abs(tau).max(axis=0) / rig.tau_max).tolist()
    return {f"peak_torque_{joint}": peak for joint, peak in zip(rig.joints, peaks)}


def describe_rig(rig: Rig) -> list[str]:
    """Return all that a rig's behaviour depends on, as text."""
    return [rig.urdf, repr((rig.limits, rig.motors, rig.config))]


def make_study(
    variation: Variation,
    controller: StoredController | Tuning | None,
    retune: bool,
    platform: bool,
    seconds: float,
) -> Study:
    """Return the run of every rig; the controller knows the nominal rig, or its own model.

    The motion of platforms is known from another run than that on which the camera is held.

    Raises:
        UsageError: The rig cannot hold its camera, or a run is too short to show its jitter.
    """
    stored = controller.stored if isinstance(controller, Tuning) else controller
    wish, law, model = (
        (stored.wish, stored.law, stored.model) if stored else (Wish(), None, variation.model)
    )
    recipe = None
    if platform:
        if seconds <= SHORTEST_HOLDING:
            what = f"is {seconds:g} s, of which the first {SETTLING:g} s do not count"
            raise UsageError("--seconds", what, f"give over {SHORTEST_HOLDING:g} s")
        if reason := unable(model.rig, WANTED):
            mend = "state or change that in its YAML"
            raise UsageError(f"rig {model.rig.name}", f"cannot hold its camera: {reason}", mend)
        recipe = learn_recipe(model.rig, None, Station.of(model.rig), model, delay=wish.samples)
        recipe = replace(recipe, dt=wish.dt, law=law)
    if not retune:
        law = law or tune(variation.model, **vars(wish)).controller
    return Study(variation, wish, None if retune else law, seconds, recipe)
