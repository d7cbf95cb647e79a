"""Is what is left only noise? Patterns that any cause outside the library would leave somewhere.

Hats over angle, rate, torque, acceleration, time and the other joints' angles, and the torque through resonators:
noise repeats none of them from block to block. Then whether anything can be learned from the motion at all, and
whether the rest is like noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.fit import Fit
from gimbal_pin.diagnosis.flips import flipped
from gimbal_pin.diagnosis.learned import predictable
from gimbal_pin.diagnosis.noiselike import peaked, rare, shared, uneven
from gimbal_pin.diagnosis.score import score
from gimbal_pin.diagnosis.state import State
from gimbal_pin.log import Array

HATS = 7
"""Hats over each variable."""
RESONANCES = (2.0, 4.0, 6.0, 9.0)
"""Resonators that the torque is sent through, Hz."""
RUNG = "around"
"""What is said before the frequency of one of them."""
SURE = 0.001
"""Chance of calling the noise of any of a log's joints structured by any of its patterns."""
FLIPS = 999
SEEN = 0.3
"""Size under which structure does not matter, in units of what is left, or of the noise floor where that is more."""
MUCH = 4.0
"""Dispersion from which much is left: it must be like noise, too, not only without pattern."""
NEARLY_ALL = 0.88
"""Share of much that must be explained where more is left than any sensor's noise, or so as to leave nothing open."""
NOISY = 40.0
"""Dispersion from which what is left must be as small and as even as the slow noise of a torque sensor."""
ACCURATE = 0.02
"""Share of a joint's torque, rms, up to which such noise goes: what current sensors promise of gain and offset.
Third differences of the torque, by which its noise is told, see nothing of it."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """Columns to look for in the residual, whitened, as `fit.Placed`, with bounds, and where it concentrates."""

    where: str
    joint: int | None
    own: Array
    lower: Array
    upper: Array
    bulk: float = 1.0
    shared: Array | None = None


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

    @property
    def rings(self) -> bool:
        """Whether what is left is, most of all, the torque through a resonator."""
        return self.where.startswith(RUNG)


def judge(state: State, rng: np.random.Generator) -> tuple[Residual, ...]:
    """Judge each joint's residual."""
    evidence, dispersion = state.problem.evidence, state.fit.dispersion
    return tuple(
        Residual("structured" if where else "noise", evidence.noise_floor(j), float(dispersion[j]), where)
        for j in range(evidence.rig.n)
        for where in (place(state, j, rng),)
    )


def place(state: State, joint: int, rng: np.random.Generator) -> str:
    """Where one joint's residual is structured; "" if it is noise."""
    evidence, dispersion = state.problem.evidence, float(state.fit.dispersion[joint])
    where = concentrated(state.fit, patterns(evidence, state.torque, joint), joint, rng)
    if where:
        return where
    if predictable(state.fit, evidence, state.torque, joint, rng):
        return "over the motion"
    if dispersion > MUCH and (where := unlike_noise(state, joint)):
        return where
    return "everywhere" if dispersion > NOISY and foreign(state, joint) else ""


def foreign(state: State, joint: int) -> bool:
    """Whether what is left is more than a torque sensor's slow noise can be, or less even."""
    evidence = state.problem.evidence
    left = evidence.noise_floor(joint) * np.sqrt(state.fit.dispersion[joint])
    torque = np.concatenate(evidence.torque)[:, joint]
    return bool(left > ACCURATE * np.sqrt(np.mean(torque**2))) or uneven(pieces(state, joint), gates(evidence, joint))


def gates(evidence: Evidence, joint: int) -> list[Array]:
    """How far one joint's gate is open at every row, one array per part."""
    return [part.gate[np.arange(part.rows) * len(part.gate) // part.rows, joint] for part in evidence.parts]


def concentrated(now: Fit, library: list[Pattern], joint: int, rng: np.random.Generator) -> str:
    """The pattern that one joint's residual shows most, or ""."""
    sure = SURE / len(now.scale)
    limit = min(float(np.quantile(flipped(now, library, rng, FLIPS), sure)), sure / max(len(library), 1))
    rows = [(score(now, pattern, False), pattern) for pattern in library]
    least = SEEN * float(np.sqrt(max(now.dispersion[joint], 1.0)))
    found = [(s.gain, pattern.where) for s, pattern in rows if s.p < limit and s.size[joint] > least]
    return max(found)[1] if found else ""


def unlike_noise(state: State, joint: int) -> str:
    """What one joint's residual has that no sensor's noise has, or ""."""
    own, *others = (pieces(state, k) for k in (joint, *(k for k in loud(state) if k != joint)))
    if rare(own):
        return "in few moments"
    if peaked(own):
        return "at single frequencies"
    return "together with other joints" if any(shared(own, other) for other in others) else ""


def loud(state: State) -> list[int]:
    """Joints at which much is left."""
    return [j for j, dispersion in enumerate(state.fit.dispersion) if dispersion > MUCH]


def pieces(state: State, joint: int) -> list[Array]:
    """One joint's residual, one array per part."""
    evidence = state.problem.evidence
    ends = np.cumsum([part.rows for part in evidence.parts])[:-1]
    return np.split(state.fit.residual[joint :: evidence.rig.n], ends)


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
    way = [part.slide[:, joint] for part in evidence.parts]
    turned = [[hat * s for hat, s in zip(columns, way)] for columns in hats(named["over its angle"])]
    out += [made(evidence, "over its angle, with its direction", joint, columns) for columns in turned]
    for frequency in RESONANCES:
        rung = [resonated(x[:, joint], frequency, part.dt) for part, x in zip(evidence.parts, torque)]
        out.append(made(evidence, f"{RUNG} {frequency:g} Hz", joint, rung))
    return out


def made(evidence: Evidence, where: str, joint: int, columns: Sequence[Array]) -> Pattern:
    """Whiten one pattern's columns, one array (m,) or (m, c) per part."""
    white = evidence.whiten(columns, joint)
    white = white[:, None] if white.ndim == 1 else white
    wide = np.full(white.shape[1], np.inf)
    return Pattern(where, joint, white, -wide, wide)


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
