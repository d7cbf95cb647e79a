"""Can what is left be predicted from the motion at all? A smooth function, learned on some time, tried on other time.

Random features (Rahimi and Recht 2007) of angle, rate, acceleration, torque and way back, ridge regression over folds,
and the signs of blocks flipped for what the same does with noise of this colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence, Part
from gimbal_pin.diagnosis.fit import Fit, project
from gimbal_pin.log import Array

FEATURES = 80
FOLDS = 5
FLIPS = 999
RIDGE = 0.03
"""Penalty, as a share of the rows."""
LEARNT = 0.1
"""Share of the residual's power, in time not learned from, that must be predicted."""
SEEN = 0.5
"""Root mean square of what is predicted under which it does not matter, in units of the noise floor."""
DRAWS = 3
"""Draws of the features of which each must predict it: what is there is found by any, what is luck by one."""
OWN = 5
"""Arguments of the joint itself: way back, angle, rate, acceleration and torque."""
WIDTH_OWN, WIDTH_ALL = 2.0, 3.0
"""How many standard deviations of its arguments a feature is wide: the more arguments, the wider."""


class Features(NamedTuple):
    """Whitened features at a joint, (rows, f)."""

    joint: int
    own: Array


def predictable(now: Fit, evidence: Evidence, torque: Sequence[Array], joint: int, rng: np.random.Generator) -> bool:
    """Whether one joint's residual is a function of its own motion, or of all joints'."""
    least = max(LEARNT, SEEN**2 * max(float(evidence.used()[joint]), 1e-3) / power(now, joint))
    every = arguments(evidence, torque, joint)
    for count, width in ((OWN, WIDTH_OWN), (None, WIDTH_ALL)):
        z = [x[:, :count] for x in every]
        if all(learnt(now, evidence.whiten(features(z, width, rng), joint), joint, least, rng) for _ in range(DRAWS)):
            return True
    return False


def learnt(now: Fit, white: Array, joint: int, least: float, rng: np.random.Generator) -> bool:
    """Whether whitened features, (rows, f), predict more than some least share, and more than they do of any noise."""
    share, null = explained(now, white, joint, rng)
    return share > least and share > float(np.max(null))


def power(now: Fit, joint: int) -> float:
    """Mean square of what is left at a joint, in units of the noise floor.

    The fit's dispersion is bounded below, as what fits better than the sensors allow is no knowledge of them.
    """
    return float(np.mean(now.residual[now.rows(joint)] ** 2) * now.dispersion[joint])


def arguments(evidence: Evidence, torque: Sequence[Array], joint: int) -> list[Array]:
    """What a torque may depend on, the `OWN` arguments of the joint first, one array (m, d) per part."""
    others = [k for k in range(evidence.rig.n) if k != joint]
    stroke = max(evidence.seen[joint].travel / 8, 1e-3)
    return [
        np.column_stack([bent(part.channels.q[:, joint], stroke), *(held(part, x, k) for k in (joint, *others))])
        for part, x in zip(evidence.parts, torque)
    ]


def held(part: Part, torque: Array, joint: int) -> Array:
    """Angle, rate, acceleration and torque of one joint, (m, 4)."""
    c = part.channels
    return np.stack([c.q[:, joint], c.v[:, joint], c.a[:, joint], torque[:, joint]], axis=1)


def bent(q: Array, stroke: float) -> Array:
    """Play of width 2 over the angle in strokes: where in a hysteresis the way has led, in [-1, 1], (m,)."""
    out, z, before = [], 0.0, float(q[0])
    for now in q.tolist():
        z, before = min(max(z + (now - before) / stroke, -1.0), 1.0), now
        out.append(z)
    return np.array(out)


def features(arguments: Sequence[Array], width: float, rng: np.random.Generator) -> list[Array]:
    """``cos(w·z + b)`` of the standardised arguments, one array (m, `FEATURES`) per part."""
    every = np.concatenate(list(arguments))
    mean, std = every.mean(axis=0), np.maximum(every.std(axis=0), 1e-12)
    w = rng.normal(size=(every.shape[1], FEATURES)) / width
    b = rng.uniform(0.0, 2 * np.pi, FEATURES)
    return [np.cos((z - mean) / std @ w + b) for z in arguments]


def explained(now: Fit, white: Array, joint: int, rng: np.random.Generator) -> tuple[float, Array]:
    """Share of a joint's residual predicted in folds not learned from, and the same with blocks' signs flipped.

    Args:
        now: The fit that left the residual.
        white: Whitened features at the joint, (rows, f).
        joint: The joint.
        rng: For the signs.
    """
    own, starts = now.rows(joint), now.starts // len(now.scale)
    rest, left = project(now, Features(joint, white))[own], now.residual[own]
    rest = rest / np.maximum(np.sqrt(np.mean(rest**2, axis=0)), 1e-300)
    signs = rng.choice([-1.0, 1.0], size=(now.blocks, FLIPS + 1))
    signs[:, 0] = 1.0
    # A flip turns whole blocks over: all that it changes is the sign of a block's products with the features.
    products = np.add.reduceat(rest * left[:, None], starts, axis=0)
    fold = np.arange(now.blocks) * FOLDS // now.blocks
    grams = [X.T @ X for X in (rest[fold[now.block[own]] == k] for k in range(FOLDS))]
    missed = np.zeros(FLIPS + 1)
    for k, gram in enumerate(grams):
        here = fold == k
        penalty = RIDGE * len(rest) * np.eye(len(gram))
        known = sum((other for other in grams if other is not gram), penalty)
        beta = np.linalg.solve(known, products[~here].T @ signs[~here])
        missed += np.sum(beta * (gram @ beta - 2 * products[here].T @ signs[here]), axis=0)
    share = -missed / (left @ left)
    return float(share[0]), share[1:]
