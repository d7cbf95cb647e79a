"""Controllers judged on plants that are not quite their model, as the real one is not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from gimbal_pin.control.experiment import perturbed
from gimbal_pin.control.laws.uncertainty import STATED_ALPHA, draw_model, estimate, home
from gimbal_pin.control.tracking import Witness, minimum_jerk, scale_steps
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.dynamics.simulation import Controller, simulate
from gimbal_pin.effects import Term
from gimbal_pin.effects.coulomb import Coulomb
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.signal import SignalMemory
from gimbal_pin.effects.stribeck import Stribeck
from gimbal_pin.effects.torque_table import TorqueTable
from gimbal_pin.errors import UsageError, finite_or_none
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng, make_generator


@dataclass(frozen=True, eq=False)
class Judgement(Record):
    """How closely controllers follow a step of all axes on perturbed plants, beside the last of them, a PID.

    Attributes:
        rig: The rig.
        plants: How many.
        errors: Controller → root mean square of reference less true angle, rad, (plants, n); inf where the loop
            diverged, and never less than `resolved`.
        resolved: What the encoders resolve, rad rms, (n,).
        seed: Repeats it as `rng`; None where a generator was given.
    """

    rig: Rig
    plants: int
    errors: Mapping[str, Array]
    resolved: Array
    seed: int | None = None

    ROWS: ClassVar[str] = "errors"
    __repr__ = brief

    @property
    def joints(self) -> tuple[str, ...]:
        """Names, (n)."""
        return self.rig.joints

    def compute_ratios(self, name: str) -> Array:
        """The PID's error over a controller's, (plants, n + 1): of each joint, and their geometric mean."""
        rival = list(self.errors.values())[-1]
        own = self.errors[name]
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = np.nan_to_num(rival / own, nan=1.0, posinf=np.inf)
            return np.column_stack([ratios, np.exp(np.log(ratios).mean(axis=1))])

    def to_dict(self) -> dict[str, Any]:
        """Return median and worst of errors, rad, and of the PID's over them; null where a loop diverged."""
        ratios = {name: self.compute_ratios(name) for name in list(self.errors)[:-1]}

        def name_joints(values: Array) -> dict[str, float | None]:
            return {j: finite_or_none(x) for j, x in zip((*self.joints, "all"), values.tolist())}

        def summarise(every: Mapping[str, Array], worst: Callable[..., Array]) -> dict[str, Any]:
            figures: dict[str, Callable[..., Array]] = {"median": np.median, "worst": worst}
            return {
                n: {key: name_joints(of(x, axis=0)) for key, of in figures.items()}
                for n, x in every.items()
            }

        own = {"errors": summarise(self.errors, np.max), "ratios": summarise(ratios, np.min)}
        return {"plants": self.plants, "resolved": name_joints(self.resolved), **own}


def judge_controllers(
    model: Model,
    controllers: Mapping[str, Controller],
    *,
    rng: Rng = None,
    plants: int = 50,
    delay: float = 0.001,
    sensors: Sensors | None = None,
    rest: float | None = None,
) -> Judgement:
    """Step all axes by minimum jerk on perturbed plants, from settled starts, with every controller.

    On each plant all meet the same noise. A plant has the noise of its drives, a delay that is up to a third more or
    less, friction near standstill that logs do not tell, and either parameters drawn from the covariance of the model's
    (bodies 10 % and friction 30 % off where it has none) or, where the model misses some, a torque drawn as large as
    that: the covariance holds what is missed as an error of parameters, and it is not there twice.

    Args:
        model: What is believed of the plant.
        controllers: Name → controller; the last one is what the others are compared with.
        rng: Source of plants and noise, or its seed; None: a fresh one, whose seed is in the result.
        plants: How many.
        delay: Time from measurement to torque, s, as believed.
        sensors: The sensors; None: those of `assume_sensors`.
        rest: Time before the step in which starts off balance settle, s; None: five time constants of the slowest
            integral action, four seconds at most.
    """
    generator, seed = make_generator(rng)
    rig = model.rig
    laws = list(controllers.values())
    sense = sensors or assume_sensors(model, laws[0].dt)
    if rest is None:
        slow = [kp / ki for law in laws for kp, ki, _ in getattr(law, "gains", ()) if ki]
        rest = min(4 * max(slow, default=0.25), 4.0)
    reference = plan_step(model, laws[0].dt, rest)
    errors = np.empty((len(laws), plants, rig.n))
    resolved = sense.encoder_step / np.sqrt(12)
    for k in tqdm(
        range(plants), "judged on perturbed plants", unit="plant", disable=None, leave=False
    ):
        plant = perturb_plant(model, reference, delay, generator)
        own = int(generator.integers(2**63))
        for law, rows in zip(laws, errors):
            error = measure_error(plant, law, reference, rest, sense, own)
            rows[k] = np.maximum(np.nan_to_num(error, nan=np.inf), resolved)
    return Judgement(rig, plants, dict(zip(controllers, errors)), resolved, seed)


def assume_sensors(model: Model, dt: float) -> Sensors:
    """Return the rig's sensors; an encoder that is not stated has the step of the rounding in the model's logs."""
    sense = Sensors.of(model.rig, dt)
    known = model.estimated
    if known is None or not known.angle_noise:
        return sense
    steps = np.where(
        sense.encoder_step > 0, sense.encoder_step, np.sqrt(12) * np.array(known.angle_noise)
    )
    return replace(sense, encoder_step=steps)


def plan_step(model: Model, dt: float, rest: float) -> Motion:
    """Return the step that controllers are judged by: `rest` s at home, all axes by minimum jerk, rest."""
    start = home(model.rig)
    return minimum_jerk(start, start + scale_steps(model), dt=dt, before=rest)


def measure_error(
    plant: Model,
    law: Controller,
    reference: Motion,
    rest: float,
    sensors: Sensors,
    rng: Rng,
    delay: int = 0,
) -> Array:
    """Root mean square of reference less true angle from `rest` s on, rad, (n,); nan where the loop diverges."""
    witness = Witness(**vars(sensors))
    try:
        simulate(plant, law, reference, rng=rng, sensors=witness, delay=delay)
    except UsageError:
        return np.full(plant.rig.n, np.nan)
    error = (reference.q - np.array(witness.seen))[reference.t >= rest - law.dt / 2]
    return np.sqrt(np.mean(error**2, axis=0))


def perturb_plant(model: Model, reference: Motion, delay: float, rng: np.random.Generator) -> Model:
    """Return a plant that the model's uncertainty leaves possible, its drives late and noisy; see above."""
    rig = model.rig
    known = model.estimated
    missed, density = ((), ()) if known is None else (known.missed, known.pure_error or known.noise)
    is_torque = any(missed) and rng.random() < 0.5
    if is_torque:
        plant = replace(model, estimated=None)
    elif estimate(model) is None:
        shares = 1 + 3 * STATED_ALPHA * rng.uniform(-1, 1, len(model.terms))
        terms = [
            replace(t, values=tuple((x * np.array(t.values)).tolist()))
            for t, x in zip(model.terms, shares)
        ]
        plant = replace(model, rig=perturbed(rig, STATED_ALPHA, rng).rig, terms=tuple(terms))
    else:
        plant = draw_model(model, rng)
    late = delay * (1 + rng.uniform(-1, 1) / 3)
    rows = zip(rig.joints, missed if is_torque else (), reference.q.T, reference.v.T)
    rest = [draw_torque(joint, x, rms, rng) for joint, rms, *x in rows if rms]
    rest += draw_standstill_friction(model, rng) if missed else []
    held = model.inverse_dynamics(reference.q[0], *np.zeros((2, rig.n)))
    std = np.array(density or [0.0] * rig.n) / np.sqrt(2 * float(reference.t[1] - reference.t[0]))
    noise = std[:, None] * rng.standard_normal((len(std), len(reference.t)))
    drawn = zip(rig.joints, held.tolist(), noise.tolist())
    drive = [FlawedDrive(joint, late, level, tuple(draws)) for joint, level, draws in drawn]
    return replace(plant, terms=(*plant.terms, *rest), drive=(*plant.drive, *drive))


def draw_standstill_friction(
    model: Model, rng: np.random.Generator, speed: float = 0.1
) -> list[Term]:
    """Return dry friction that is up to 30 % more or less where joints hardly move: no row tells which way it acts.

    Of dry machines it is lost at .01 to .1 rad/s (Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30, 1994).
    """
    dry = [term for term in model.terms if isinstance(term.effect, Coulomb)]
    shares = (3 * STATED_ALPHA * rng.uniform(-1, 1, len(dry))).tolist()
    return [
        Term(Stribeck(one.effect.joint, speed, 1), (x * one.values[0],))
        for one, x in zip(dry, shares)
    ]


def draw_torque(
    joint: str, channels: Sequence[Array], rms: float, rng: np.random.Generator, knots: int = 7
) -> Term:
    """Return a torque of a size, N m rms, that is a function of the joint's angle or of its rate along a motion.

    Between two of its knots the variance is two thirds of theirs on average.
    """
    which = int(rng.integers(2))
    low = float(channels[which].min())
    high = float(channels[which].max())
    places = np.linspace(low - 0.1, high + 0.1, knots)
    values = abs(rms) * np.sqrt(1.5) * rng.standard_normal(knots)
    return Term(
        TorqueTable(joint, ("angle", "rate")[which], tuple(places.tolist())), tuple(values.tolist())
    )


@dataclass(frozen=True)
class FlawedDrive(Delay):
    """``y(t) = x(t - time) + draw``, the draws in turn, N m; until the first command acts, x is `held`, N m."""

    held: float = 0.0
    draws: tuple[float, ...] = (0.0,)

    def start(self, level: float = 0.0) -> SignalMemory:
        """Return the number of the first draw, and what is held."""
        return (0.0, self.held)

    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """Add the next draw."""
        place, *past = memory
        late, y = super().step(tuple(past), x, dt)
        return (place + 1, *late), y + self.draws[int(place) % len(self.draws)]
