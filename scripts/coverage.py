"""Coverage of 95 % intervals with an effect at one joint that the model does not hold.

Bodies are drawn from the URDF's as the trust says, the payload is moved by some 5 mm and changed by some 10 % of its
mass, and friction by 20 %; a ripple of 14 per turn, a spring or extra friction near standstill is added to one joint's
torque. Printed is which share lies in its interval: of the bodies' figures, of the friction at the other joints, of the
payload's place (at its true mass, where the log leaves it a function of that) and mass. Logs are one of 10 s, one of
60 s, two of 10 s, or two of 10 s with another camera each, of which the first is as its URDF says.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from gimbal_pin.dynamics.model import nominal
from gimbal_pin.effects.rig_effect import get_payload, shift_inertia
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import (
    IdentificationResult,
    PayloadStatement,
    compare_payload,
    identify,
    identify_several,
)
from gimbal_pin.identification.bodies import compute_figures
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import TRUST
from gimbal_pin.regression.consistency import compute_deformation_root
from gimbal_pin.rig.inertia import is_physical
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import EXACT, prescribed

EFFECTS = ("none", "ripple", "spring", "stiction")
"""What is added, in turn."""
LOGS = {"10 s": (10.0,), "60 s": (60.0,), "two logs": (10.0, 10.0), "two cameras": (10.0, 10.0)}
"""Their lengths; of two cameras one each."""
FIRST, SECOND = "mirrorless", "zoom-lens"
"""Payloads; of one camera the first."""
FIGURES = ("bodies", "friction", "place", "mass")
SHARE = 0.7
"""Size of it, as a share of the joint's torque, rms over rms."""


def missed(kind: str, q: Array, v: Array, phase: float) -> Array:
    """Torque of an effect over a joint's motion, of unit size at most, (N,)."""
    shapes = {
        "none": np.zeros_like(q),
        "ripple": np.sin(14 * q + phase),
        "spring": np.tanh(3 * (q - np.mean(q))),
        "stiction": np.exp(-((v / 0.2) ** 2)) * np.sign(v),
    }
    return np.asarray(shapes[kind])


class Truth(NamedTuple):
    """A rig that differs from its URDF, and its payload's shift, m, (3,), and mass, kg."""

    rig: Rig
    shift: Array
    mass: float


def get_phi_of_payload(rig: Rig, shift: Array, share: float = 1.0) -> Array:
    """What a payload that is moved, m, and whose mass is multiplied makes of the bodies' parameters, (10 n,)."""
    body, inertia, frame = get_payload(rig)
    phi = np.zeros(10 * rig.n)
    phi[10 * body : 10 * body + 10] = (
        share * shift_inertia(inertia, frame, shift).toDynamicParameters()
    )
    return phi


def draw_bodies(rig: Rig, rng: np.random.Generator) -> Array:
    """Ten parameters of every body without the payload, stretched and sheared as the trust says, (10 n,)."""
    bare = rig.phi - get_phi_of_payload(rig, np.zeros(3))
    root = TRUST * compute_deformation_root(bare)
    while not all(
        map(is_physical, (phi := bare + root @ rng.standard_normal(len(root))).reshape(-1, 10))
    ):
        pass
    return np.asarray(phi)


def draw_truth(
    rig: Rig, bare: Array, rub: Array, is_as_stated: bool, rng: np.random.Generator
) -> Truth:
    """The rig of these bodies with friction multiplied, (n, 2), and the payload as stated, or moved and heavier."""
    shift, share = (
        (np.zeros(3), 1.0)
        if is_as_stated
        else (0.005 * rng.standard_normal(3), rng.uniform(0.85, 1.15))
    )
    there = replace(
        rig.with_phi(bare + get_phi_of_payload(rig, shift, share)), friction=rub * rig.friction
    )
    return Truth(there, shift, share * float(get_payload(rig)[1].mass))


def record(truth: Truth, kind: str, joint: int, seconds: float, rng: np.random.Generator) -> Log:
    """A log of it with an effect at a joint."""
    log = prescribed(
        nominal(truth.rig), int(rng.integers(2**31)), seconds, torque_noise=0.01, dt=4e-3
    )
    tau = np.array(log.tau)
    added = missed(kind, log.q[:, joint], np.asarray(log.v)[:, joint], rng.uniform(0, 2 * np.pi))
    tau[:, joint] += SHARE * np.std(tau[:, joint]) * added / max(float(np.std(added)), 1e-12)
    return replace(log, tau=tau)


def is_inside(value: float, std: float, true: float) -> bool:
    """Whether a 95 % interval holds the truth."""
    return abs(value - true) <= 1.96 * std


def judge_gimbal(
    found: IdentificationResult, truth: Truth, joint: int
) -> Iterator[tuple[str, bool]]:
    """Yield for every figure of the bodies, and of the friction at other joints, whether its interval holds it."""
    for body, own in zip(found.bodies, truth.rig.phi.reshape(-1, 10)):
        for figure, true in zip((body.mass, *body.com, *body.inertia), compute_figures(own)):
            yield "bodies", is_inside(figure.value, figure.std, true)
    width = len(found.reduction.independent)
    kinds = truth.rig.friction.shape[1]
    for k, true in enumerate(truth.rig.friction.ravel().tolist()):
        if k // kinds != joint:
            yield (
                "friction",
                is_inside(found.estimate.theta[width + k], found.estimate.std[width + k], true),
            )


def locate_camera(camera: Mapping[str, Any], mass: float) -> list[float | None]:
    """``c(m) = c₀ + c₀' m₀ (1 - m₀/m)``: where a log places a camera of a mass, mm; None where it does not show.

    The first moment is what shows: the place goes with 1/m, of which the slope c₀' at the stated m₀ is the tangent.

    Args:
        camera: `given_model` of `PayloadStatement.to_dict`.
        mass: Its mass; where the log shows one, the place is that one's.
    """
    stated = camera["stated_mass"]
    lacks = 0.0 if camera["mass"] is not None else stated * (1 - stated / mass)
    return [
        None if x is None else x + lacks * slope
        for x, slope in zip(camera["com_mm"], camera["com_mm_per_g"])
    ]


def judge_payload(said: PayloadStatement, truth: Truth) -> Iterator[tuple[str, bool]]:
    """Yield whether the intervals of place and mass hold the truth, as far as they are stated."""
    if said.apart is None:
        return
    row: dict[str, Any] = said.apart.to_dict()["camera"]
    for x, std, true in zip(
        locate_camera(row, 1e3 * truth.mass), row["com_std_mm"], 1e3 * truth.shift
    ):
        if x is not None:
            yield "place", is_inside(x, std, true)
    if row["mass"] is not None:
        yield "mass", is_inside(row["mass"] + row["stated_mass"], row["mass_std"], 1e3 * truth.mass)


def judge(name: str, logs: str, kind: str, rng: np.random.Generator) -> Iterator[tuple[str, bool]]:
    """Yield every figure of one draw, and whether its interval holds the truth."""
    payloads = (FIRST, SECOND) if logs == "two cameras" else (FIRST,)
    rigs = {payload: Rig.load(name, payload) for payload in payloads}
    first = rigs[FIRST]
    bare = draw_bodies(first, rng)
    joint = int(rng.integers(first.n))
    rub = rng.uniform(0.8, 1.2, first.friction.shape)
    if len(rigs) == 1:
        truth = draw_truth(first, bare, rub, False, rng)
        found = identify(
            first, [record(truth, kind, joint, s, rng) for s in LOGS[logs]], filtering=EXACT
        )
        yield from judge_gimbal(found, truth, joint)
        yield from judge_payload(compare_payload(found), truth)
        return
    truths = {one: draw_truth(rig, bare, rub, one == FIRST, rng) for one, rig in rigs.items()}
    each = {
        one: [record(truth, kind, joint, s, rng)]
        for (one, truth), s in zip(truths.items(), LOGS[logs])
    }
    several = identify_several(rigs, each, filtering=EXACT)
    for one, truth in truths.items():
        yield from judge_gimbal(several.identified[one], truth, joint)
        yield from judge_payload(several.payloads[one], truth)


def main() -> None:
    """Print the coverage by effect and logs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rig", default="drone")
    parser.add_argument("--logs", type=int, default=75, help="draws of each effect")
    parser.add_argument("--of", nargs="+", choices=tuple(LOGS), default=tuple(LOGS))
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    sys.stdout.write(
        "| logs | effect | " + " | ".join(FIGURES) + " | refused |\n" + "|---" * 7 + "|\n"
    )
    for logs in asked.of:
        for kind in EFFECTS:
            rng = np.random.default_rng([asked.seed, list(LOGS).index(logs), EFFECTS.index(kind)])
            hits = defaultdict[str, list[bool]](list)
            refused = 0
            for _ in tqdm(range(asked.logs), desc=f"{logs}, {kind}", leave=False):
                try:
                    for what, yes in list(judge(asked.rig, logs, kind, rng)):
                        hits[what].append(yes)
                except GimbalPinError:
                    refused += 1
            told = [
                f"{100 * np.mean(hits[what]):.1f} % of {len(hits[what])}" if hits[what] else ""
                for what in FIGURES
            ]
            sys.stdout.write(f"| {logs} | {kind} | " + " | ".join(told) + f" | {refused} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
