"""Coverage of 95 % intervals of bodies with an effect at one joint that the model does not hold.

Bodies are drawn from the URDF's as the trust says, a ripple of 14 per turn, a spring or extra friction near standstill
is added to one joint's torque, and the share of figures that lie in their intervals is printed, by effect.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from gimbal_pin.dynamics.model import nominal
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import identify
from gimbal_pin.identification.bodies import compute_figures
from gimbal_pin.log.log import Array
from gimbal_pin.regression import TRUST
from gimbal_pin.regression.consistency import compute_deformation_root
from gimbal_pin.rig.inertia import is_physical
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import EXACT, prescribed

EFFECTS = ("none", "ripple", "spring", "stiction")
"""What is added, in turn."""
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


def inside(rig: Rig, kind: str, rng: np.random.Generator) -> Iterator[bool]:
    """Yield for every figure of the bodies whether its interval holds the truth, on one log."""
    root = TRUST * compute_deformation_root(rig.phi)
    while not all(map(is_physical, (phi := rig.phi + root @ rng.standard_normal(len(root))).reshape(-1, 10))):
        pass
    seed, joint = int(rng.integers(2**31)), int(rng.integers(rig.n))
    log = prescribed(nominal(rig.with_phi(phi)), seed, 20.0, torque_noise=0.01, dt=4e-3)
    tau = np.array(log.tau)
    added = missed(kind, log.q[:, joint], np.asarray(log.v)[:, joint], rng.uniform(0, 2 * np.pi))
    tau[:, joint] += SHARE * np.std(tau[:, joint]) * added / max(float(np.std(added)), 1e-12)
    for body, own in zip(identify(rig, [replace(log, tau=tau)], filtering=EXACT).bodies, phi.reshape(-1, 10)):
        for figure, true in zip((body.mass, *body.com, *body.inertia), compute_figures(own)):
            yield abs(figure.value - true) <= 1.96 * figure.std


def main() -> None:
    """Print the coverage by effect, of some logs each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rig", default="drone")
    parser.add_argument("--logs", type=int, default=75, help="of each effect")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    rig, rng = Rig.load(asked.rig), np.random.default_rng(asked.seed)
    for kind in EFFECTS:
        hits, failed = list[bool](), 0
        for _ in range(asked.logs):
            try:
                hits += inside(rig, kind, rng)
            except GimbalPinError:
                failed += 1
        sys.stdout.write(f"{kind:9s} {100 * np.mean(hits):5.1f} % of {len(hits)} figures, {failed} logs refused\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
