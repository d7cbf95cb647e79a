"""A known gimbal with a new camera: what was known, what the log says, and whether the two agree.

The log alone gives ``θ̂ = θ + K γ + e`` with e of covariance P; θ was known as θ₀, to its covariance P₀. With
d = θ̂ - θ₀ and V = P₀ + P the camera is ``γ = (KᵀV⁻¹K)⁻¹ KᵀV⁻¹ d`` and the gimbal ``θ = θ₀ + P₀V⁻¹ (d - Kγ)``. If both
covariances are right, ``rᵀV⁻¹r`` of r = d - Kγ is χ² of as many squares as d has beyond γ. Where it is significantly
more, P₀ is widened until it is that many (Paule and Mandel, J. Res. NBS 87, 1982).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import fdtri

from gimbal_pin.dynamics.model import Estimated
from gimbal_pin.errors import DataError, digits
from gimbal_pin.identification.payload_change import FALSE_CHANGE, SQUARES
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Estimate, decompose, whiten

LARGEST_WIDENING = 1e8
"""Times that known variances are widened at most: of deviations ten thousand times as wide nothing is left."""
WORST = 3
"""How many parameters a sentence names."""


class Updated(NamedTuple):
    """What is known after the log.

    Attributes:
        theta: All parameters, then the camera's gamma, (k + r,).
        covariance: Their covariance, (k + r, k + r).
        widening: Times that the known variances were widened; one where the log agrees.
        apart: The log's parameters less the known ones and the camera's, in deviations of that, (k,).
    """

    theta: Array
    covariance: Array
    widening: float
    apart: Array


def compute_limit(squares: int) -> float:
    """Mean of so many squares of unit deviation that chance exceeds once in a thousand, see `payload_change`."""
    return float(fdtri(squares, SQUARES, 1 - FALSE_CHANGE))


def update_gimbal(before: Estimated, alone: Estimate, reach: Array, place: str) -> Updated:
    """Return the gimbal and the camera from what was known and what the log says.

    Args:
        before: The known parameters.
        alone: All parameters as the log alone gives them, the gimbal with the camera.
        reach: K: change of the parameters per parameter of the camera, (k, r).
        place: What an error names: the log.

    Raises:
        DataError: The log contradicts what was known, however wide.
    """
    from scipy.optimize import brentq

    seen = np.isfinite(alone.std)
    K = reach[seen]
    d = (alone.theta - before.theta)[seen]
    P = alone.covariance[np.ix_(seen, seen)]
    known = before.covariance[np.ix_(seen, seen)]

    def unexplained(widening: float) -> tuple[Array, Array, Array]:
        """Return ``V^-½``, the map from d to gamma, and that from d to r."""
        V = widening * known + P
        white = whiten(V)
        camera = decompose(white @ K).inverse @ white
        return white, camera, np.eye(len(d)) - K @ camera

    squares = len(d) - K.shape[1]

    def excess(logarithm: float) -> float:
        white, _, rest = unexplained(float(np.exp(logarithm)))
        return float(np.sum((white @ rest @ d) ** 2)) / squares - 1.0

    white, _, rest = unexplained(1.0)
    apart = np.zeros(len(seen))
    apart[seen] = rest @ d / np.sqrt(np.diag(known + P))
    widening = 1.0
    if squares > 0 and excess(0.0) + 1.0 > compute_limit(squares):
        if excess(np.log(LARGEST_WIDENING)) > 0:
            mend = "identify the gimbal anew: logs of all cameras together, LOG@PAYLOAD …"
            raise DataError(
                place, "is of another gimbal than --known, whatever camera is mounted", mend
            )
        widening = float(np.exp(brentq(excess, 0.0, np.log(LARGEST_WIDENING))))
    white, camera, rest = unexplained(widening)
    wide = widening * before.covariance
    gain = np.zeros((len(seen) + len(camera), len(seen)))
    gain[:, seen] = np.vstack([wide[:, seen] @ white.T @ white @ rest, camera])
    left = gain - np.eye(*gain.shape)
    noise = gain[:, seen] @ P @ gain[:, seen].T
    theta = np.append(before.theta, np.zeros(len(camera))) + gain[:, seen] @ d
    return Updated(theta, left @ wide @ left.T + noise, widening, apart)


def describe_contradiction(found: Updated, before: Estimated) -> tuple[str, ...]:
    """Say that the log contradicts what was known, if it does."""
    if found.widening <= 1:
        return ()
    order = np.argsort(-np.abs(found.apart))[:WORST]
    worst = ", ".join(f"{before.names[k]} by {digits(abs(found.apart[k]), 2)}" for k in order)
    return (
        f"the gimbal is not as --known has it ({worst} deviations): what was known counts with deviations "
        f"{digits(found.widening**0.5, 2)} times as wide; identify the gimbal anew, logs of all cameras together",
    )
