"""How wrong the inverted model may be: bounds for Lyapunov redesign, and the gain of a loop."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.model import Estimated, Model
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import compute_regressor, compute_rnea
from gimbal_pin.effects import Sample
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import BASE_MOTIONS, Platform
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

EXAMINED_POSES = 40
VARIED = 200
"""Poses over which an inertia that a PID takes as constant is looked at."""
SETS = 100
STATED_ALPHA = 0.1
"""‖I - D⁻¹ D̂‖ of a model that was never identified: inertias from a drawing, 10 % off."""
STATED_PHI = 0.1
"""Share of gravity, Coriolis and friction torque by which such a model is off."""
UNLIMITED_RATE = 2.0
"""Largest joint rate looked at where the rig states no limit, rad/s."""


@dataclass(frozen=True)
class ModelErrorBounds:
    """Bounds on the model error ``q̈ - y = (D⁻¹ D̂ - I) y + D⁻¹ ñ``.

    Attributes:
        alpha: ‖I - D⁻¹ D̂‖ ≤ α.
        phi: ‖ñ‖ ≤ Φ, error of gravity, Coriolis and friction torque, N m.
        inverse: ‖D⁻¹‖ ≤ B_M, 1/(kg m²).
        source: Where the bounds come from, as a sentence.
    """

    alpha: float
    phi: float
    inverse: float
    source: str

    __repr__ = brief


def sample_poses(rig: Rig, count: int = EXAMINED_POSES) -> tuple[Array, Array]:
    """Angles and rates that fill the rig's limits evenly and always alike, (count, n) each; the first is home, at rest.

    A Kronecker sequence, like the reduction's: what is derived from it depends on the rig alone.
    """
    primes = [k for k in range(2, 600) if all(k % d for d in range(2, int(k**0.5) + 1))][
        : 2 * rig.n
    ]
    unit = np.outer(np.arange(count), np.sqrt(primes)) % 1.0
    lower = np.array([max(limit.lower, -np.pi) for limit in rig.limits])
    upper = np.array([min(limit.upper, np.pi) for limit in rig.limits])
    top = np.array([min(limit.velocity, UNLIMITED_RATE) for limit in rig.limits])
    q = lower + (upper - lower) * unit[:, : rig.n]
    v = top * (2 * unit[:, rig.n :] - 1)
    q[0], v[0] = home(rig), 0.0
    return q, v


def home(rig: Rig) -> Array:
    """All angles zero, or as near to it as the limits let, rad, (n,)."""
    return np.array([min(max(0.0, limit.lower), limit.upper) for limit in rig.limits])


def compute_inertia(model: Model, q: Array) -> Array:
    """``D(q)``, (N, n, n), with what the terms add to its diagonal (a rotor's inertia)."""
    rig = model.rig
    data = model.rig.model.createData()
    out = np.empty((len(q), rig.n, rig.n))
    for row, angles in zip(out, q):
        upper = np.triu(pin.crba(rig.model, data, angles))
        row[...] = upper + np.triu(upper, 1).T
    zero = np.zeros_like(q)
    extra = model.passive(q, zero, zero + 1.0, zero, zero) - model.passive(
        q, zero, zero, zero, zero
    )
    return out + extra[:, :, None] * np.eye(rig.n)


def bounds(model: Model, rng: np.random.Generator) -> ModelErrorBounds:
    """Return the bounds over poses and rates within the limits.

    A model with a covariance is compared with parameter sets drawn from it: α and Φ are what 95 % of the sets do not
    exceed at any pose. One without (or with that of another rig's parameters) gets the stated defaults.
    """
    q, v = sample_poses(model.rig)
    D = compute_inertia(model, q)
    largest = float(1 / np.linalg.eigvalsh(D)[:, 0].min())
    known = estimate(model)
    if known is None:
        load = np.linalg.norm(model.inverse_dynamics(q, v, np.zeros_like(q)), axis=1).max()
        shares = f"{100 * STATED_ALPHA:.0f} % of inertia, {100 * STATED_PHI:.0f} % of the rest"
        source = f"no covariance of its parameters: {shares} assumed"
        return ModelErrorBounds(STATED_ALPHA, float(STATED_PHI * load), largest, source)
    deviation = known[0].covariance
    places = known[1]
    draws = draw_changes(deviation, SETS, rng)
    alpha, phi = (
        float(np.quantile(x, 0.95)) for x in bound_drawn_models(model, places, q, v, D, draws)
    )
    source = f"from the estimated covariance, {SETS} parameter sets at {len(q)} poses, 95 %"
    return ModelErrorBounds(alpha, phi, largest, source)


def factor_covariance(covariance: Array) -> Array:
    """Return ``D C^½``, (k, k), with deviations D and correlations C.

    Of all roots it is the one whose columns are most their own parameters' (ZCA-cor: Kessy, Lewin and Strimmer, The
    American Statistician 72, 2018). It does not hang on the signs of eigenvectors, which rounding decides. Correlations
    are factored and not covariances: rounding of a huge variance, such as of a drift that a log hardly shows, would
    otherwise exceed the variance of an inertia.
    """
    std = np.sqrt(np.diag(covariance)) + 1e-150
    size, ways = np.linalg.eigh(covariance / np.outer(std, std))
    return np.asarray(std[:, None] * (ways * np.sqrt(np.maximum(size, 0.0))) @ ways.T)


def draw_changes(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw errors of parameters from a normal distribution, (count, k)."""
    root = factor_covariance(covariance)
    return np.asarray(rng.standard_normal((count, len(root))) @ root.T)


def bound_drawn_models(
    model: Model, places: Array, q: Array, v: Array, D: Array, draws: Array
) -> tuple[Array, Array]:
    """α and Φ of each drawn parameter set, (sets,) each: the largest over the poses."""
    rest = columns(model, places, q, v, np.zeros_like(q))
    push = pushes(model, places, q, v)
    eye = np.eye(q.shape[1])
    errors = []
    for draw in draws:
        wrong = np.linalg.solve(D + push @ draw, D) - eye
        alpha = np.linalg.norm(wrong, ord=2, axis=(1, 2)).max()
        errors.append((alpha, np.linalg.norm(rest @ draw, axis=1).max()))
    alpha, phi = np.array(errors).T
    return alpha, phi


def pushes(model: Model, places: Array, q: Array, v: Array) -> Array:
    """``∂D(q)/∂θ``, (N, n, n, k): what one unit of each estimated parameter adds to the inertia matrix."""
    zero = np.zeros_like(q)
    rest = columns(model, places, q, v, zero)
    return np.stack(
        [columns(model, places, q, v, zero + row) - rest for row in np.eye(q.shape[1])], axis=2
    )


def columns(
    model: Model, places: Array, q: Array, v: Array, a: Array, platform: Platform | None = None
) -> Array:
    """Torque per unit of each estimated parameter, (N, n, k): base columns, then the terms' own bases."""
    rig = model.rig
    tau = compute_rnea(rig, q, v, a, platform)
    parts = [compute_regressor(rig, q, v, a, platform)[:, :, places]]
    weight = model.weight(q, platform)
    for term in model.terms:
        j = rig.joint_index(term.effect.joint)
        own = (x[:, j] for x in (q, v, a, np.sign(v), tau))
        at = Sample(np.zeros(len(q)), *own)._replace(weight=weight[:, j])
        part = np.zeros((*q.shape, len(term.values)))
        for k, basis in enumerate(term.effect.basis(at)):
            part[:, j, k] = basis
        parts.append(part)
    return np.concatenate(parts, axis=2)


def estimate(model: Model) -> tuple[Estimated, Array] | None:
    """Return a model's estimate, and where in `Rig.phi` its base parameters are.

    None where it has no covariance, or one of another rig or of other terms.
    """
    known = model.estimated
    if known is None:
        return None
    width = len(known.names) - sum(len(term.values) for term in model.terms)
    for diagonal, base in itertools.product((False, True), BASE_MOTIONS):
        reduction = reduce_parameters(model.rig, diagonal, base)
        if reduction.base_names == tuple(known.names[:width]):
            return known, find_base_columns(model.rig, reduction)
    return None


DRAWN_MODELS = 200
GAIN_CEILING = 1e3
"""Largest gain looked at: an inertia a thousand times smaller than believed, or one that no body has."""

Ratios = tuple[tuple[float, ...], ...]
"""Per joint: lowest gain of the plant over what the law believes, one, and the highest."""


def draw_inertia_ratios(model: Model, kind: str, rng: np.random.Generator) -> Ratios | None:
    """Return each joint's ``D̂_jj/D_jj``: lowest, one, highest over `DRAWN_MODELS` parameter sets and all poses.

    D_jj is the inertia that the joint turns while the others hold still, its rotor's included; D̂ that of the model, at
    the same pose for computed torque and at home for a PID. A loop's margins fall off on both sides of its best gain,
    so the two ends have the worst of all draws. What else a set changes (gravity, friction) acts far below the
    crossover. A set that no body has (D_jj ≤ 0) counts as `GAIN_CEILING`.

    None where the model has no covariance, or one of another rig's parameters.

    Args:
        model: The model, as identified.
        kind: "computed-torque" or "pid".
        rng: Source of the draws; the same one gives deviations in proportion to the model's.
    """
    known = estimate(model)
    if known is None:
        return None
    covariance = known[0].covariance
    places = known[1]
    q, _ = sample_poses(model.rig, VARIED if kind == "pid" else EXAMINED_POSES)
    believed = np.diagonal(compute_inertia(model, q), axis1=1, axis2=2)
    sets = draw_changes(covariance, DRAWN_MODELS, rng)
    change = np.moveaxis(
        np.diagonal(pushes(model, places, q, np.zeros_like(q)), axis1=1, axis2=2), 1, 2
    )  # (N, n, k)
    true = believed + np.einsum("ijk,sk->sij", change, sets)
    nominal = (
        np.diagonal(compute_inertia(model, home(model.rig)[None])[0]) if kind == "pid" else believed
    )
    ratios = nominal / np.maximum(true, nominal / GAIN_CEILING)
    rows = ratios.reshape(-1, model.rig.n)
    ends = zip(rows.min(axis=0).tolist(), rows.max(axis=0).tolist())
    return tuple((min(low, 1.0), 1.0, max(high, 1.0)) for low, high in ends)


def widened(believed: Ratios, over: Ratios | None) -> Ratios:
    """Return the lowest and highest of both, and one, per joint; the first alone where there is no second."""
    if over is None:
        return believed
    return tuple(tuple(sorted({min(*a, *b), 1.0, max(*a, *b)})) for a, b in zip(believed, over))


def draw_model(model: Model, rng: np.random.Generator) -> Model:
    """Return a model whose parameters are drawn from the covariance of another one's; the same where it has none.

    A draw that no rig can have, its mass matrix not positive at some pose, is halved until one can.
    """
    known = estimate(model)
    if known is None:
        return replace(model, estimated=None)
    covariance = known[0].covariance
    (q, _) = sample_poses(model.rig)
    change = draw_changes(covariance, 1, rng)[0]
    for share in (*0.5 ** np.arange(10), 0.0):
        found = change_parameters(model, share * change)
        if np.linalg.eigvalsh(compute_inertia(found, q)).min() > 0:
            break
    return found


def change_parameters(model: Model, change: Array) -> Model:
    """Return a model with its estimated parameters changed, (k,): base parameters, then the terms', within bounds."""
    known = estimate(model)
    if known is None:
        return replace(model, estimated=None)
    phi = model.rig.phi.copy()
    places = known[1]
    terms = []
    phi[places] += change[: len(places)]
    rest = change[len(places) :]
    for term in model.terms:
        own, rest = np.split(rest, [len(term.values)])
        rows = zip(term.values, own.tolist(), term.effect.coefficients)
        values = [min(max(x + more, min(p.lower, x)), max(p.upper, x)) for x, more, p in rows]
        terms.append(replace(term, values=tuple(values)))
    return replace(model, rig=model.rig.with_phi(phi), terms=tuple(terms), estimated=None)
