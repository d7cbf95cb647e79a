"""Distributions of what differs between rigs, the draws from them, and the rig that drawn values make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from gimbal_pin.control.laws.uncertainty import change_parameters, estimate, factor_covariance
from gimbal_pin.dynamics.apply import plant_with
from gimbal_pin.dynamics.model import Estimated, Model, is_motor_friction, replace_bodies
from gimbal_pin.effects import RigEffect, Signal, Term
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.effects.payload_mass import PayloadMass
from gimbal_pin.effects.payload_shift import PayloadShift
from gimbal_pin.effects.rig_effect import get_payload
from gimbal_pin.errors import UsageError
from gimbal_pin.rig.reading import read_yaml
from gimbal_pin.rig.records import read_record

Values = Mapping[str, float]
DISTRIBUTION_SYNTAX = "write a number, [uniform, LOWEST, HIGHEST] or [normal, MEAN, DEVIATION]"
MIN_PROBABILITY = 1e-12
"""Smallest probability at which a distribution is looked up: seven deviations of a normal one."""


class Distribution(NamedTuple):
    """Distribution ``offset + scale x``, x uniform on 0 to 1 or standard normal; of a fixed number the scale is 0."""

    kind: str
    offset: float
    scale: float


def parse_distribution(stated: Any, place: str) -> Distribution:
    """Return the distribution that a file states."""
    kind, *numbers = (
        stated if isinstance(stated, (list, tuple)) and stated else ("normal", stated, 0.0)
    )
    is_number = [
        isinstance(x, (int, float)) and not isinstance(x, bool) and isfinite(x) for x in numbers
    ]
    if kind not in ("uniform", "normal") or is_number != [True, True]:
        raise UsageError(place, f"is {stated!r}", DISTRIBUTION_SYNTAX)
    offset, second = map(float, numbers)
    scale = second - offset if kind == "uniform" else second
    if scale < 0:
        wrong = "lowest exceeds its highest" if kind == "uniform" else "deviation is negative"
        raise UsageError(place, f"is {stated!r}, whose {wrong}", DISTRIBUTION_SYNTAX)
    return Distribution(kind, offset, scale)


@dataclass(frozen=True)
class Vary:
    """Content of a file of variations; each value is a number or a distribution, see `DISTRIBUTION_SYNTAX`.

    Attributes:
        parameters: Errors of the model's parameters, in the deviations of their estimated covariance.
        inertials: Error of each body's mass, moments and inertia, as a share.
        friction: Error of each joint's friction, as a share.
        payload: `x`, `y`, `z`: offset of the payload, mm; `mass`: error of its mass, as a share.
        delay: Delay of every drive, s.
        effects: ``CAUSE[:JOINT]`` → its parameters, in SI units and radians.
    """

    parameters: Any = field(default=("normal", 0.0, 1.0))
    inertials: Any = 0.0
    friction: Any = 0.0
    payload: Mapping[str, Any] = field(default_factory=dict)
    delay: Any = 0.0
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def choose_default_vary(model: Model) -> Vary:
    """Return the default: the estimate's covariance, 1 mm and 2 % of a payload, and a delay of up to 1 ms.

    A model without covariance stands for a drawing: inertias within 5 %, friction within 20 %.
    """
    drawing: dict[str, Any] = {"inertials": ("normal", 0.0, 0.05), "friction": ("normal", 0.0, 0.2)}
    try:
        get_payload(model.rig)
        mounted = {**dict.fromkeys("xyz", ("normal", 0.0, 1.0)), "mass": ("normal", 0.0, 0.02)}
    except UsageError:
        mounted = {}
    return Vary(
        **({} if estimate(model) else drawing), payload=mounted, delay=("uniform", 0.0, 0.001)
    )


@dataclass(frozen=True, eq=False)
class Variation:
    """Rigs that differ from a model.

    Attributes:
        model: The nominal rig.
        vary: The statement of what varies.
        estimated: Estimate of the model's parameters; None: it has none.
        distributions: Name → distribution, fixed numbers included.
        inputs: Names of those that vary.
    """

    model: Model
    vary: Vary
    estimated: Estimated | None
    distributions: Mapping[str, Distribution]
    inputs: tuple[str, ...]

    def choose_values(self, probabilities: Sequence[float]) -> dict[str, float]:
        """Return all numbers, from the probabilities of the inputs."""
        x = dict(
            zip(self.inputs, np.clip(probabilities, MIN_PROBABILITY, 1 - MIN_PROBABILITY).tolist())
        )
        return {
            name: own.offset
            + own.scale * float(ndtri(x[name]) if own.kind == "normal" else x[name])
            if own.scale
            else own.offset
            for name, own in self.distributions.items()
        }

    def make_body(self, values: Values) -> Model:
        """Return the model with its parameters and its payload changed: the model that an identification would find."""
        model = self.model
        rig = self.model.rig
        if self.estimated is not None:
            off = np.array([values[f"parameters.{name}"] for name in self.estimated.names])
            model = change_parameters(model, factor_covariance(self.estimated.covariance) @ off)
        phi = model.rig.phi * np.repeat(
            [1 + values[f"inertials.{link}"] for link in rig.links[: rig.n]], 10
        )
        terms = []
        for term in model.terms:
            factor = (
                1 + values[f"friction.{term.effect.joint}"]
                if is_motor_friction(term.effect)
                else 1.0
            )
            terms.append(replace(term, values=tuple(x * factor for x in term.values)))
        model = replace(
            model,
            rig=replace_bodies(model.rig, phi, model.armature),
            terms=tuple(terms),
            estimated=None,
        )
        offset = [values.get(f"payload.{axis}", 0.0) / 1000 for axis in "xyz"]
        causes: list[PayloadShift | PayloadMass] = [PayloadShift(*offset)] if any(offset) else []
        if extra := values.get("payload.mass", 0.0):
            causes.append(PayloadMass(extra * float(get_payload(model.rig)[1].mass)))
        return plant_with(model, causes).plant

    def make_plant(self, body: Model, values: Values) -> Model:
        """Return the model with what an identification would not find: planted effects and delays of the drives."""
        causes: list[Term | Signal | RigEffect] = []
        if values["delay"]:
            causes += [Delay(joint, values["delay"]) for joint in body.rig.joints]
        for key, numbers in self.vary.effects.items():
            stated = ",".join(f"{name}={values[f'{key}.{name}']!r}" for name in numbers)
            causes.append(parse_effect(f"{key}:{stated}", body.rig))
        plant, drive = plant_with(body, causes)
        return replace(plant, drive=(*plant.drive, *drive))


def make_variation(model: Model, vary: Vary | str | Path | None = None) -> Variation:
    """Return the rigs that differ from a model as a file or a `Vary` states, or by `choose_default_vary`.

    Raises:
        UsageError: A statement is wrong, or no rig at the upper quartiles of all inputs can exist.
    """
    place = str(vary) if isinstance(vary, (str, Path)) else "vary"
    if isinstance(vary, (str, Path)):
        vary = read_record(Vary, read_yaml(vary), place, UsageError)
    vary = vary or choose_default_vary(model)
    known = (estimate(model) or (None,))[0]
    if unknown := set(vary.payload) - {*"xyz", "mass"}:
        raise UsageError(
            f"{place}: payload", f"has an unknown key '{min(unknown)}'", "give x, y, z (mm) or mass"
        )
    stated = {f"parameters.{name}": vary.parameters for name in (known.names if known else ())}
    stated |= {f"inertials.{link}": vary.inertials for link in model.rig.links[: model.rig.n]}
    stated |= {f"friction.{joint}": vary.friction for joint in model.rig.joints}
    stated |= {f"payload.{name}": value for name, value in vary.payload.items()}
    stated["delay"] = vary.delay
    stated |= {
        f"{cause}.{name}": x for cause, own in vary.effects.items() for name, x in own.items()
    }
    forms = {name: parse_distribution(x, f"{place}: {name}") for name, x in stated.items()}
    variation = Variation(
        model, vary, known, forms, tuple(name for name, own in forms.items() if own.scale)
    )
    values = variation.choose_values([0.75] * len(variation.inputs))
    try:
        variation.make_plant(variation.make_body(values), values)
    except UsageError as error:
        raise UsageError(f"{place}: {error.place}", error.what, error.mend) from error
    return variation


class RigDraw(NamedTuple):
    """Probabilities of one rig's inputs in their distributions, and the seed of its noise."""

    probabilities: tuple[float, ...]
    seed: int


def draw_rigs(
    inputs: Sequence[str], count: int, seed: int = 0, sobol: bool = False
) -> list[RigDraw]:
    """Draw rigs, each from its own place in the seed.

    Args:
        inputs: Names of what varies, d of them.
        count: Number of rigs; with `sobol` of base points A and B, each of which takes d + 2 rigs: A, A with each input
            from B, B.
        seed: Seed of everything random.
        sobol: True draws the design of `scipy.stats.sobol_indices` from a scrambled Sobol' sequence; all rigs then have
            the same noise. False draws independent rigs with noise of their own.
    """
    width = len(inputs)
    if not sobol:
        rngs = [np.random.default_rng([seed, 1, k]) for k in range(count)]
        return [
            RigDraw(tuple(rng.random(width).tolist()), int(rng.integers(2**63))) for rng in rngs
        ]
    if not inputs:
        raise UsageError("--sobol", "has nothing that varies", "state distributions in --vary")
    if count.bit_count() != 1:
        near = 2 ** (count.bit_length() - 1)
        raise UsageError(
            "--count", f"is {count}, the base of a Sobol' design", f"give {near} or {2 * near}"
        )
    noise = int(np.random.default_rng([seed, 2, 0]).integers(2**63))
    a, b = np.split(qmc.Sobol(2 * width, seed=seed).random(count), 2, axis=1)
    mixed = [np.where(np.arange(width) == k, b, a) for k in range(width)]
    points = np.stack([a, *mixed, b], axis=1).reshape(-1, width)
    return [RigDraw(tuple(point), noise) for point in points.tolist()]
