"""What differs from rig to rig: inputs with their distributions, the rig that their values make, and where to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from gimbal_pin.control.laws.uncertainty import change_parameters, estimate
from gimbal_pin.dynamics.apply import plant_with
from gimbal_pin.dynamics.model import Estimated, Model, is_motor_friction, replace_bodies
from gimbal_pin.effects import RigEffect, Signal, Term
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.effects.payload_mass import PayloadMass
from gimbal_pin.effects.payload_shift import PayloadShift
from gimbal_pin.effects.rig_effect import get_payload
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import read_yaml
from gimbal_pin.rig.records import read_record
from gimbal_pin.rig.rig import Rig

Values = Mapping[str, float]
DISTRIBUTION_SYNTAX = "write a number, [uniform, LOWEST, HIGHEST] or [normal, MEAN, DEVIATION]"
MIN_PROBABILITY = 1e-12
"""Smallest probability at which a distribution is looked up: seven deviations of a normal one."""


def parse_distribution(written: Any, place: str) -> Any:
    """Return what a file states of a number: the number, or its distribution of `scipy.stats` where it varies."""
    kind, *numbers = written if isinstance(written, (list, tuple)) and written else ("uniform", written, written)
    real = [isinstance(x, (int, float)) and not isinstance(x, bool) and isfinite(x) for x in numbers]
    if kind not in ("uniform", "normal") or real != [True, True]:
        raise UsageError(place, f"is {written!r}", DISTRIBUTION_SYNTAX)
    first, second = map(float, numbers)
    scale = second - first if kind == "uniform" else second
    if scale < 0:
        wrong = "lowest exceeds its highest" if kind == "uniform" else "deviation is negative"
        raise UsageError(place, f"is {written!r}, whose {wrong}", DISTRIBUTION_SYNTAX)
    return {"uniform": stats.uniform, "normal": stats.norm}[kind](first, scale) if scale else first


@dataclass(frozen=True)
class Vary:
    """What a file of variations states; each value is a distribution, see `parse_distribution`.

    Attributes:
        parameters: What the model's parameters are off by, in the deviations of their estimated covariance.
        inertials: By which share each body's mass, moments and inertia are off.
        friction: By which share each joint's friction is off.
        payload: `x`, `y`, `z`: how far it sits from where it should, mm; `mass`: by which share its mass is off.
        delay: How much later every drive acts, s.
        torque_noise: White noise on each motor's torque, N m.
        encoder_step: Angle of one encoder step, rad.
        gyro_noise: Noise density of the gyros, rad/s/√Hz.
        effects: ``CAUSE[:JOINT]`` → its parameters, in SI units and radians.
        own_noise: Whether each unit meets noise and a platform's motion of its own, rather than all the same.
    """

    parameters: Any = field(default=("normal", 0.0, 1.0))
    inertials: Any = 0.0
    friction: Any = 0.0
    payload: Mapping[str, Any] = field(default_factory=dict)
    delay: Any = 0.0
    torque_noise: Any = 0.0
    encoder_step: Any = None
    gyro_noise: Any = None
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    own_noise: bool = True


def choose_default_vary(model: Model) -> Vary:
    """Return what varies unless a file says: what is estimated by its covariance, and how a payload is mounted.

    A model without covariance stands for a drawing: inertias within 5 %, friction within 20 %.
    """
    drawing: dict[str, Any] = {"inertials": ("normal", 0.0, 0.05), "friction": ("normal", 0.0, 0.2)}
    try:
        get_payload(model.rig)
        mounted = {**dict.fromkeys("xyz", ("normal", 0.0, 1.0)), "mass": ("normal", 0.0, 0.02)}
    except UsageError:
        mounted = {}
    return Vary(**({} if estimate(model) else drawing), payload=mounted, delay=("uniform", 0.0, 0.001))


def read_vary(path: str | Path) -> Vary:
    """Read a file of variations."""
    return read_record(Vary, read_yaml(path), str(path), UsageError)


@dataclass(frozen=True, eq=False)
class Variation:
    """Rigs that differ from a model.

    Attributes:
        model: The nominal rig.
        vary: What varies.
        place: Where that is stated, for errors.
    """

    model: Model
    vary: Vary
    place: str = "vary"

    @cached_property
    def estimated(self) -> Estimated | None:
        """The estimate of the model's parameters, if it has one."""
        return (estimate(self.model) or (None,))[0]

    @cached_property
    def distributions(self) -> Mapping[str, Any]:
        """All numbers, fixed ones too, by their names."""
        vary, rig, known = self.vary, self.model.rig, self.estimated
        if unknown := set(vary.payload) - {*"xyz", "mass"}:
            raise UsageError(f"{self.place}: payload", f"knows no '{min(unknown)}'", "give x, y, z (mm) or mass")
        stated = {f"parameters.{name}": vary.parameters for name in (() if known is None else known.names)}
        stated |= {f"inertials.{link}": vary.inertials for link in rig.links[: rig.n]}
        stated |= {f"friction.{joint}": vary.friction for joint in rig.joints}
        stated |= {f"payload.{name}": value for name, value in vary.payload.items()}
        stated |= {name: getattr(vary, name) for name in ("delay", "torque_noise", "encoder_step", "gyro_noise")}
        stated |= {f"{cause}.{name}": x for cause, own in vary.effects.items() for name, x in own.items()}
        return {name: parse_distribution(x, f"{self.place}: {name}") for name, x in stated.items() if x is not None}

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of those that vary."""
        return tuple(name for name, own in self.distributions.items() if not isinstance(own, float))

    def values(self, shares: Sequence[float]) -> dict[str, float]:
        """Return all numbers, from the inputs' places in their distributions, 0 to 1."""
        inside = np.clip(shares, MIN_PROBABILITY, 1 - MIN_PROBABILITY)
        drawn = {name: float(self.distributions[name].ppf(share)) for name, share in zip(self.inputs, inside)}
        return {**self.distributions, **drawn}

    def check(self) -> None:
        """Raise what there is against the file: a rig at the inputs' upper quartiles can be made."""
        body = self.make_body(values := self.values([0.75] * len(self.inputs)))
        for key, written in {"delay": self.vary.delay, **self.vary.effects}.items():
            try:
                self.make_causes(key, body.rig, values)
            except UsageError as error:
                place = f"{self.place}: {key if key == 'delay' else f'effects: {key}'}"
                raise UsageError(place, f"is {written!r}: {error.what}", error.mend) from error
        self.make_plant(body, values)

    def make_body(self, values: Values) -> Model:
        """Return the model with its parameters and its payload changed: what identifying such a unit would find."""
        model, rig = self.model, self.model.rig
        if self.estimated is not None:
            off = np.array([values[f"parameters.{name}"] for name in self.estimated.names])
            model = change_parameters(model, factor_covariance(self.estimated.covariance) @ off)
        phi = model.rig.phi * np.repeat([1 + values[f"inertials.{link}"] for link in rig.links[: rig.n]], 10)
        share = {joint: 1 + values[f"friction.{joint}"] for joint in rig.joints}
        factors = [share[term.effect.joint] if is_motor_friction(term.effect) else 1.0 for term in model.terms]
        rubbed = (replace(t, values=tuple(x * factor for x in t.values)) for t, factor in zip(model.terms, factors))
        model = replace(model, rig=replace_bodies(model.rig, phi), terms=tuple(rubbed), estimated=None)
        place = [values.get(f"payload.{axis}", 0.0) / 1000 for axis in "xyz"]
        causes: list[PayloadShift | PayloadMass] = [PayloadShift(*place)] if any(place) else []
        if extra := values.get("payload.mass", 0.0):
            causes.append(PayloadMass(extra * float(get_payload(model.rig)[1].mass)))
        return plant_with(model, causes).plant

    def make_plant(self, body: Model, values: Values) -> Model:
        """Return the model with what an identification would not find: planted causes, and drives that act late."""
        keys = ("delay", *self.vary.effects)
        plant, drive = plant_with(body, [cause for key in keys for cause in self.make_causes(key, body.rig, values)])
        return replace(plant, drive=(*plant.drive, *drive))

    def make_causes(self, key: str, rig: Rig, values: Values) -> list[Term | Signal | RigEffect]:
        """Return what `delay`, or an entry of `effects`, plants."""
        if key == "delay":
            return [Delay(joint, values[key]) for joint in rig.joints if values[key]]
        stated = ",".join(f"{name}={values[f'{key}.{name}']!r}" for name in self.vary.effects[key])
        return [parse_effect(f"{key}:{stated}", rig)]


def factor_covariance(covariance: Array) -> Array:
    """``D C^½``, deviations D and correlations C: of all roots the one whose columns are most their own parameters'.

    Kessy, Lewin, Strimmer, The American Statistician 72 (2018): ZCA-cor.
    """
    std = np.sqrt(np.diag(covariance))
    size, ways = np.linalg.eigh(covariance / np.outer(*[np.maximum(std, 1e-150)] * 2))
    return np.asarray(std[:, None] * (ways * np.sqrt(np.maximum(size, 0.0))) @ ways.T)


class Unit(NamedTuple):
    """One rig of a design: its inputs' places in their distributions, 0 to 1, and the seed of its noise."""

    shares: tuple[float, ...]
    seed: int


@dataclass(frozen=True, eq=False)
class RigDesign(Sequence[Unit]):
    """The rigs that are looked at, each drawn on access and from its own place alone.

    Attributes:
        inputs: Names of what varies.
        size: Rigs; of a Sobol design its base points, each of which takes as many rigs as there are inputs, and two.
        seed: Seed of everything random.
        sobol: Saltelli's design for Sobol indices, rather than independent draws.
        own_noise: Whether each rig of independent draws has noise of its own.
    """

    inputs: tuple[str, ...]
    size: int
    seed: int = 0
    sobol: bool = False
    own_noise: bool = True

    def __post_init__(self) -> None:
        """Refuse a Sobol design that is none."""
        if self.sobol and not self.inputs:
            raise UsageError("--sobol", "has nothing that varies", "state distributions in --vary")
        if self.sobol and self.size.bit_count() != 1:
            near = 2 ** (self.size.bit_length() - 1)
            raise UsageError("--count", f"is {self.size}, the base of a Sobol design", f"give {near} or {2 * near}")

    def __len__(self) -> int:
        """Return the number of rigs."""
        return self.size * self.group

    @property
    def group(self) -> int:
        """Rigs of one base point: A, A with each input from B, B."""
        return len(self.inputs) + 2 if self.sobol else 1

    @cached_property
    def base_points(self) -> Array:
        """Scrambled Sobol sequence of A and B, (size, 2 inputs)."""
        return np.asarray(stats.qmc.Sobol(2 * len(self.inputs), seed=self.seed).random(self.size))

    def __getitem__(self, place: Any) -> Any:
        """Draw one rig."""
        k = range(len(self))[place]
        own, shared = (np.random.default_rng([self.seed, word, n]) for word, n in ((1, k), (2, 0)))
        if self.sobol:
            (a, b), step = np.split(self.base_points[k // self.group], 2), k % self.group
            shares = b if step == self.group - 1 else np.where(np.arange(len(a)) == step - 1, b, a)
        else:
            shares = own.random(len(self.inputs))
        noise = own if self.own_noise and not self.sobol else shared
        return Unit(tuple(shares.tolist()), int(noise.integers(2**63)))
