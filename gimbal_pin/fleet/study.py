"""What every rig of a Monte Carlo study goes through, a step of all axes or a camera held still, and its figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import inf, isnan, radians

import numpy as np

from gimbal_pin.control.judging import FlawedDrive
from gimbal_pin.control.laws.design import Wish
from gimbal_pin.control.tracking import track
from gimbal_pin.control.tuning import StoredController, TunedLaw, Tuning, tune
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.errors import GimbalPinError, UsageError
from gimbal_pin.fleet.engine import Value
from gimbal_pin.fleet.variation import Unit, Values, Variation
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.bench import WANTED, draw_profile, learn_recipe
from gimbal_pin.pointing.measurement import Station
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.result import SETTLING, SHORTEST_DRIFT, SHORTEST_JITTER
from gimbal_pin.pointing.run import simulate_holding
from gimbal_pin.pointing.sight import unable
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.reading import parse_decimal
from gimbal_pin.rig.rig import Rig

STEPS = {"rms_error": "°", "overshoot_percent": "%", "settling_time": "s", "peak_torque": ""}
"""Figures of a step and their units for people (none: a share of the limit), joint by joint and the largest of all."""
SHORTEST_HOLDING = SETTLING + SHORTEST_JITTER
"""Shortest run that holds a camera, s: its start does not count, and the rest must show jitter."""
SHORTEST_DRIFTING = SETTLING + SHORTEST_DRIFT
"""Shortest run that shows how a camera drifts, s."""
PLATFORM = {"jitter": "°", "jitter_max": "°", "drift": "°", "peak_torque": ""}
"""The same of a camera on profile S; only the torque is joint by joint, too."""
SCALES = {
    "°": {"°": radians(1.0), "deg": radians(1.0), "rad": 1.0},
    "mm": {"mm": 1e-3, "m": 1.0},
    **{unit: {unit: 1.0} for unit in ("%", "s", "")},
}
"""A figure's unit for people → the units that a requirement may be in, in SI units."""


@dataclass(frozen=True)
class Limit:
    """One requirement: a figure stays below a bound, in rad, s, per cent or as a share; `text` is what asked for it."""

    figure: str
    bound: float
    text: str


def parse_limit(text: str, known: Mapping[str, str]) -> Limit:
    """Return what ``FIGURE < NUMBER`` asks; an angle is in degrees, a place in mm, unless ``rad`` or ``m`` follows.

    Raises:
        UsageError: It asks nothing, or speaks of a figure that is not in `known`, figure → unit.
    """
    figure, _, rest = (part.strip() for part in text.partition("<"))
    number, _, word = rest.partition(" ")
    place, mend = f"--spec '{text}'", f"write FIGURE < NUMBER with one of {', '.join(known)}"
    if figure not in known:
        raise UsageError(place, f"speaks of '{figure}', which is no figure of these runs", mend)
    if rest.startswith("="):
        raise UsageError(place, "compares by <=", "write <")
    unit = known[figure]
    scale, bound = SCALES[unit].get(word.strip() or unit), parse_decimal(number)
    if scale is None or not bound or bound < 0:
        raise UsageError(place, f"states no positive number of {unit or 'a share'}", mend)
    return Limit(figure, bound * scale, text)


def list_figures(rig: Rig, platform: bool) -> dict[str, str]:
    """Return the names of the figures, and their units for people.

    Where some joints slide and some turn, no error is the largest of all.
    """
    if platform:
        return PLATFORM | {f"peak_torque_{joint}": "" for joint in rig.joints}
    kinds = {joint: "mm" if slides else "°" for joint, slides in zip(rig.joints, rig.slides)}
    each = {f"{name}_{joint}": kinds[joint] if unit == "°" else unit for name, unit in STEPS.items() for joint in kinds}
    common = {name: {each[f"{name}_{joint}"] for joint in kinds} for name in STEPS}
    return {name: units.pop() for name, units in common.items() if len(units) == 1} | each


@dataclass(frozen=True, eq=False)
class Study:
    """What every unit goes through; workers get it with their units.

    Attributes:
        variation: The rigs.
        wish: What a controller is asked for.
        law: The controller; None: tuned anew for each unit.
        seconds: Length of a run, s.
        recipe: What holds a camera on profile S; None: the rig steps on a base that stands.
        holder: The one of its controllers for all units; None: each unit's own.
    """

    variation: Variation
    wish: Wish
    law: TunedLaw | None
    seconds: float
    recipe: Recipe | None = None
    holder: Holder | None = None

    def describe(self) -> dict[str, object]:
        """Return what the results depend on."""
        model, law, known = self.variation.model, self.law, self.variation.estimated
        believed = getattr(law, "model", model).to_dict()
        gains = None if law is None else [law.gains, repr(vars(law).get("robust")), believed]
        return {
            "rig": model.rig.name,
            "model": [describe_rig(model.rig), model.to_dict()],
            "covariance": None if known is None else known.covariance.tolist(),
            "controller": [vars(self.wish), gains],
            "seconds": self.seconds,
            "platform": self.recipe is not None,
            "vary": asdict(self.variation.vary),
        }

    def run(self, unit: Unit) -> dict[str, Value]:
        """Return a unit's inputs and figures, or its inputs and why no such rig can be or be simulated."""
        values = self.variation.values(unit.shares)
        inputs: dict[str, Value] = {name: values[name] for name in self.variation.inputs}
        try:
            body = self.variation.make_body(values)
            plant = self.add_torque_noise(self.variation.make_plant(body, values), values["torque_noise"], unit.seed)
            law = self.law or tune(body, **vars(self.wish)).controller
            if self.recipe is None:
                return {**inputs, **self.simulate_step(law, plant, values, unit.seed)}
            own = replace(self.recipe, model=body, law=self.recipe.law and law)
            return {**inputs, **self.hold_camera(self.holder or own.pointer(own.kind), plant, values, unit.seed)}
        except GimbalPinError as error:
            return {**inputs, "error": str(error)}

    def add_torque_noise(self, plant: Model, std: float, seed: int) -> Model:
        """Return the plant with white noise on its torques, N m."""
        if not std:
            return plant
        shape = plant.rig.n, round(self.seconds / self.wish.dt) + 1
        draws = (std * np.random.default_rng([seed, 1]).standard_normal(shape)).tolist()
        noise = [FlawedDrive(joint, 0.0, draws=tuple(own)) for joint, own in zip(plant.rig.joints, draws)]
        return replace(plant, drive=(*plant.drive, *noise))

    def simulate_step(self, law: TunedLaw, plant: Model, values: Values, seed: int) -> dict[str, float]:
        """Return the figures of a step of all axes: of no overshoot 0, of a joint that did not settle infinite."""
        rig, sensors = plant.rig, Sensors.of(plant.rig, law.dt)
        if (density := values.get("gyro_noise")) is not None:
            sensors = replace(sensors, rate_std=np.full(rig.n, density / np.sqrt(2 * law.dt)))
        if (step := values.get("encoder_step")) is not None:
            sensors = replace(sensors, encoder_step=np.full(rig.n, step))
        noise, late, laws = np.random.default_rng([seed, 2]), self.wish.samples, {"own": law}
        steps = track(plant, laws, rng=noise, seconds=self.seconds, sensors=sensors, delay=late, one_by_one=False)
        out = compute_torque_shares(rig, np.asarray(steps.experiments[0].log.tau))
        for joint, seen in steps.experiments[0].joints.items():
            stayed = isnan(seen.overshoot_percent)
            out[f"rms_error_{joint}"] = seen.rms_error
            out[f"overshoot_percent_{joint}"] = 0.0 if stayed else seen.overshoot_percent
            out[f"settling_time_{joint}"] = 0.0 if stayed else inf if isnan(seen.settling_time) else seen.settling_time
        largest = {name: max(out[f"{name}_{joint}"] for joint in rig.joints) for name in STEPS}
        return {name: {**largest, **out}[name] for name in list_figures(rig, platform=False)}

    def hold_camera(self, holder: Holder, plant: Model, values: Values, seed: int) -> dict[str, float]:
        """Return the figures of a camera held on profile S."""
        rig, station = plant.rig, Station.of(plant.rig)
        if (density := values.get("gyro_noise")) is not None:
            station = replace(station, noise=Noise(density, station.noise.accelerometer))
        if (step := values.get("encoder_step")) is not None:
            station = replace(station, step=np.full(rig.n, step))
        ground = draw_profile(rig, self.seconds, seed, holder.dt)
        noise, late = np.random.default_rng([seed, 2]), self.wish.samples
        run = simulate_holding(plant, holder, ground, rng=noise, seconds=self.seconds, station=station, delay=late)
        shares = compute_torque_shares(rig, np.asarray(run.tau)[run.counted])
        return {**dict(zip(PLATFORM, (*run.jitter, max(shares.values())))), **shares}


def compute_torque_shares(rig: Rig, tau: Array) -> dict[str, float]:
    """Return ``peak_torque_JOINT`` → largest torque as a share of its motor's limit."""
    peaks: list[float] = (np.abs(tau).max(axis=0) / rig.tau_max).tolist()
    return {f"peak_torque_{joint}": peak for joint, peak in zip(rig.joints, peaks)}


def describe_rig(rig: Rig) -> list[str]:
    """Return all that a rig's behaviour depends on, as text."""
    return [rig.urdf, repr((rig.limits, rig.motors, rig.config))]


def make_study(
    variation: Variation, controller: StoredController | Tuning | None, retune: bool, platform: bool, seconds: float
) -> Study:
    """Return what every rig goes through; the controller knows the nominal one, or its own model.

    How platforms move is known from another motion than that on which the camera is held.

    Raises:
        UsageError: The rig cannot hold its camera, or a run is too short to show its jitter.
    """
    stored = controller.stored if isinstance(controller, Tuning) else controller
    wish, law, model = (Wish(), None, variation.model) if stored is None else (stored.wish, stored.law, stored.model)
    recipe, rig = None, model.rig
    if platform:
        if seconds <= SHORTEST_HOLDING:
            what = f"is {seconds:g} s, of which the first {SETTLING:g} s do not count"
            raise UsageError("--seconds", what, f"give over {SHORTEST_HOLDING:g} s")
        if reason := unable(rig, WANTED):
            mend = "state or change that in its YAML"
            raise UsageError(f"rig {rig.name}", f"cannot hold its camera: {reason}", mend)
        recipe = learn_recipe(rig, None, Station.of(rig), model, delay=wish.samples)
        recipe = replace(recipe, dt=wish.dt, law=law)
    if retune:
        return Study(variation, wish, None, seconds, recipe)
    law = law or tune(variation.model, **vars(wish)).controller
    return Study(variation, wish, law, seconds, recipe, None if recipe is None else recipe.pointer(recipe.kind))
