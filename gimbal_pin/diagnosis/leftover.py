"""Is what is left only noise? Patterns that any cause outside the library would leave somewhere.

Hats over angle, rate, torque, acceleration, time and the other joints' angles, and the torque through resonators:
noise repeats none of them from block to block.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.fit import Fit, flipped, score
from gimbal_pin.diagnosis.search import State
from gimbal_pin.log import Array

HATS = 7
"""Hats over each variable."""
RESONANCES = (2.0, 4.0, 6.0, 9.0)
"""Resonators that the torque is sent through, Hz."""
SURE = 0.005
"""Chance of calling noise structured."""
SEEN = 0.2
"""Size under which structure does not matter, in units of the noise floor."""
NOISY = 12.0
"""Dispersion that no sensor's coloured noise explains."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """A column to look for in the residual, whitened, (rows, n, c), and where it concentrates."""

    where: str
    joint: int
    values: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Residual:
    """What is left at one joint after all findings.

    Attributes:
        state: "noise" or "structured".
        noise_floor: What the sensors' noise alone would leave, N m rms.
        dispersion: Residual power over predicted noise power.
        where: Where the structure is, or "".
    """

    state: str
    noise_floor: float
    dispersion: float
    where: str


def judge(state: State, rng: np.random.Generator) -> tuple[Residual, ...]:
    """Judge each joint's residual."""
    evidence = state.problem.evidence
    return tuple(judged(state, j, patterns(evidence, state.torque, j), rng) for j in range(evidence.rig.n))


def judged(state: State, joint: int, library: list[Pattern], rng: np.random.Generator) -> Residual:
    """Judge one joint's residual by its patterns."""
    now: Fit = state.fit
    dispersion = float(now.dispersion[joint])
    floor = state.problem.evidence.noise_floor(joint)
    limit = float(np.quantile(flipped(now, library, rng), SURE))
    rows = [(score(now, pattern, False), pattern) for pattern in library]
    found = [
        (s.gain, pattern.where) for s, pattern in rows if s.p < min(limit, SURE / len(library)) and s.size[joint] > SEEN
    ]
    where = max(found)[1] if found else ("everywhere" if dispersion > NOISY else "")
    return Residual("structured" if where else "noise", floor, dispersion, where)


def patterns(evidence: Evidence, torque: list[Array], joint: int) -> list[Pattern]:
    """Patterns at one joint."""
    rig = evidence.rig
    named = {
        "over its angle": [part.channels.q[:, joint] for part in evidence.parts],
        "over its rate": [part.channels.v[:, joint] for part in evidence.parts],
        "over its acceleration": [part.channels.a[:, joint] for part in evidence.parts],
        "over its torque": [x[:, joint] for x in torque],
        "over time": [part.time for part in evidence.parts],
        **{
            f"over the angle of {rig.joints[k]}": [part.channels.q[:, k] for part in evidence.parts]
            for k in range(rig.n)
            if k != joint
        },
    }
    out = [made(evidence, f, joint, columns) for f, x in named.items() for columns in hats(x)]
    way = [np.sign(part.channels.v[:, joint]) for part in evidence.parts]
    turned = [[hat * s for hat, s in zip(columns, way)] for columns in hats(named["over its angle"])]
    out += [made(evidence, "over its angle, with its direction", joint, columns) for columns in turned]
    for frequency in RESONANCES:
        rung = [resonated(x[:, joint], frequency, part.dt) for part, x in zip(evidence.parts, torque)]
        out.append(made(evidence, f"around {frequency:g} Hz", joint, rung))
    return out


def made(evidence: Evidence, where: str, joint: int, columns: list[Array]) -> Pattern:
    """Whiten one pattern's columns, one array (m,) or (m, c) per part."""
    white = evidence.whiten(columns, joint)
    white = white[:, None] if white.ndim == 1 else white
    values = np.zeros((evidence.rows, evidence.rig.n, white.shape[1]))
    values[:, joint] = white
    wide = np.full(white.shape[1], np.inf)
    return Pattern(where, joint, values, -wide, wide)


def hats(signal: list[Array]) -> list[list[Array]]:
    """Triangles over the quantiles of a signal, each 1 at its knot and 0 at its neighbours', per part."""
    knots = np.unique(np.quantile(np.concatenate(signal), np.linspace(0.0, 1.0, HATS)))
    return [[np.interp(x, knots, row) for x in signal] for row in np.eye(len(knots))] if len(knots) > 2 else []


def resonated(signal: Array, frequency: float, dt: float) -> Array:
    """A signal and its derivative through a resonator, both of unit size, (m, 2)."""
    w, damping = 2 * np.pi * frequency, 0.1
    pole = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * w * dt)
    rung = lfilter([1.0], [1.0, -pole], signal)
    both = np.stack([rung.real, rung.imag], axis=1)
    return both / np.maximum(np.std(both, axis=0), 1e-12)
