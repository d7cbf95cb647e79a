"""Is every column its own joint's, and the right way round? Drives' signs and tables' columns are easily mixed up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.checks.record import Fault
from gimbal_pin.checks.series import JOINT_CHANNELS
from gimbal_pin.dynamics.configurations import spread_reference_states
from gimbal_pin.dynamics.model import build_friction_effects
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import compute_inertia_column
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import LogError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.mapping import format_remapping
from gimbal_pin.log.platform import BaseMotion
from gimbal_pin.regression import (
    Block,
    Design,
    DesignBlocks,
    Estimate,
    Filtering,
    compute_blocks,
    count_effective_rows,
    factor_rows,
    fit_bounded_bodies,
    fit_weighted,
    solve_factors,
)
from gimbal_pin.regression.consistency import LEANT_WEIGHTS
from gimbal_pin.rig.rig import Rig

POOR = 0.1
"""Residual of a joint, as a share of its torque, from which other signs are tried. What decides is
`LEAST_IMPROVEMENT`."""
LEAST_IMPROVEMENT = 0.4
"""Share of the error that columns put right may leave: several causes halve it, none of them does that by a sign."""
ERROR_RESOLUTION = 0.03
"""Share of a joint's torque to which the error need be known, and from which other orders are tried: on 16 logs with a
larger one every other order misses more, on 7 with joints exchanged the right one misses a tenth or less."""
AGREEING_CORRELATION = 0.5
"""Correlation of a joint's torque with what the given rig asks for, from which its sign is right, come what may."""
UNDRIVEN = 0.05
"""A joint with less than this share of the largest torque need not be right by a share of its own."""
ASSIGNMENT_TIME = 60.0
"""Time of each log that is looked at where it is not fitted anyway, s."""


class AssignmentTrial(NamedTuple):
    """Share of the torque that bodies miss with the columns put right in one way; what that is, and how it is done.

    `whole`: whether joints change places with all of their columns.
    """

    missed: float
    words: str
    mend: str
    whole: bool = False


def check_assignment(blocks: DesignBlocks, estimate: Estimate, name: str = "") -> None:
    """Raise `LogError` if bodies that can exist explain the torque far better with other signs or columns exchanged.

    Args:
        blocks: The rows that were fitted. Without logs, as online, signs alone are tested.
        estimate: Their weighted or any other least squares.
        name: What to call their logs; nothing: as the first of them.
    """
    if (found := find_assignment(blocks, estimate)) is not None:
        raise LogError(name or blocks.design.logs[0].name, found.words, found.mend)


def find_assignment(blocks: DesignBlocks, estimate: Estimate) -> AssignmentTrial | None:
    """Return what explains the torque of some rows far better, or None.

    Joints that have changed places are looked for where the estimate misses more than is sure to be known; signs and
    torques only where it is impossible: it makes inertia or friction drive the joints, or misses the torque of one.
    Signs alone cost least squares nothing where joints hardly feel each other; it then answers with negative masses,
    while bodies that can exist are left with the error.
    """
    groups = list[Iterator[AssignmentTrial]]()
    if np.any(estimate.residual_std > ERROR_RESOLUTION * compute_torque_size(blocks)):
        groups.append(try_orders(blocks))
    if is_impossible(blocks, estimate):
        groups += [try_smaller_rotors(blocks, estimate), try_torques(blocks)]
    for trials in groups:
        best = min(trials, key=lambda one: one.missed, default=None)
        if best is None:
            continue
        given = compute_bounded_misfit(blocks)
        if best.missed < LEAST_IMPROVEMENT * given:
            then = (
                f"bodies miss {100 * best.missed:.2g} % of the torque then, {100 * given:.2g} % now"
            )
            return best._replace(words=f"{best.words}: {then}")
    return None


def fit_beginning(
    rig: Rig, logs: Sequence[Log], base: BaseMotion, filtering: Filtering
) -> tuple[DesignBlocks, Estimate] | None:
    """Fit the first `ASSIGNMENT_TIME` seconds of logs; None where they have too few rows."""
    parts = tuple(map(take_beginning, logs))
    blocks = compute_blocks(
        Design(
            rig,
            reduce_parameters(rig, base=base),
            build_friction_effects(rig.joints),
            parts,
            filtering,
        )
    )
    if not blocks or count_effective_rows(blocks).min() <= blocks[0].A.shape[2]:
        return None
    return blocks, fit_weighted(blocks)


def check_assignment_of_logs(blocks: DesignBlocks, estimate: Estimate) -> Fault | None:
    """Check the wiring of logs that were fitted by `fit_beginning`.

    Returns:
        The fault, where joints have changed places with all of their columns; else None.

    Raises:
        LogError: As `check_assignment`, of signs and of torques that have changed places.
    """
    name = blocks.design.logs[0].name
    found = find_assignment(blocks, estimate)
    if found is None:
        return None
    if not found.whole:
        raise LogError(name, found.words, found.mend)
    missed = Parameter("missed", found.missed, "1")
    return Fault(
        "logs-disagree",
        None,
        f"{name}: {found.words}",
        (missed,),
        1.0 / LEAST_IMPROVEMENT,
        True,
        found.mend,
    )


def take_beginning(log: Log) -> Log:
    """Return the first `ASSIGNMENT_TIME` seconds of a log."""
    return log.part(slice(0, int(np.searchsorted(log.t, log.t[0] + ASSIGNMENT_TIME))))


def is_impossible(blocks: DesignBlocks, estimate: Estimate) -> bool:
    """Whether a fit says what no rig can be: see `check_assignment`."""
    rows = blocks.design
    count = len(blocks.design.reduction.independent)
    if np.any(estimate.residual_std > POOR * compute_torque_size(blocks)):
        return True
    pushing = estimate.theta[count : count + 2 * rows.rig.n].reshape(rows.rig.n, 2)
    rate = np.sqrt(np.mean(np.concatenate([block.v for block in blocks]) ** 2, axis=0))
    if np.any(pushing[:, 0] + pushing[:, 1] * rate < 0):
        return True
    return bool(np.linalg.eigvalsh(compute_mass_matrices(rows, estimate.theta[:count])).min() <= 0)


def compute_mass_matrices(rows: Design, beta: Array) -> Array:
    """``D(q)`` of base parameters over the rig's poses, (N, n, n): column j is what a unit acceleration of j takes.

    The stated rotors are left out: a log that shows less inertia than they have contradicts them.
    """
    rig = rows.rig.with_phi(rows.to_bodies(beta))
    q = spread_reference_states(rows.rig).q
    matrices = np.stack([compute_inertia_column(rig, q, j) for j in range(rig.n)], axis=2)
    return (matrices + matrices.transpose(0, 2, 1)) / 2 - np.diag(rig.armature)


def try_smaller_rotors(blocks: DesignBlocks, estimate: Estimate) -> Iterator[AssignmentTrial]:
    """Yield the torques with those stated rotors unstated that are larger than all inertia at their joints."""
    rows = blocks.design
    width = len(blocks.design.reduction.independent)
    bodies = np.diagonal(compute_mass_matrices(rows, estimate.theta[:width]), axis1=1, axis2=2).min(
        axis=0
    )
    large = (rows.rig.armature > 0) & (bodies <= 0)
    if large.any():
        without = [block._replace(b=block.b + block.known * large) for block in blocks]
        at = [
            f"{rows.rig.joints[j]} ({rows.rig.armature[j]:.3g} kg m^2)"
            for j in np.flatnonzero(large)
        ]
        words = f"has less inertia than the stated rotor of {' and '.join(at)}"
        mend = "correct rotor_inertia or gear_ratio in the rig"
        yield AssignmentTrial(
            compute_bounded_misfit(DesignBlocks(rows, tuple(without))), words, mend
        )


def try_torques(blocks: DesignBlocks) -> Iterator[AssignmentTrial]:
    """Yield single signs and all at once, and every two joints' torques exchanged where there are logs to do it in.

    No sign is turned that the given rig agrees with: bodies are free to take either side of what a limit has bent. Nor,
    without logs, that of a joint whose stated rotor takes a part of the torque: rows without a log do not hold it.
    """
    rows = blocks.design
    joints = rows.rig.joints
    n = rows.rig.n
    sources = rows.logs[0].sources if rows.logs else {}
    right = correlate_with_given(blocks) > AGREEING_CORRELATION
    right |= (rows.rig.armature > 0) & (not rows.logs)
    for signs in list_sign_patterns(n):
        if np.any(right & (np.array(signs) < 0)):
            continue
        wrong = [f"tau_{joint}" for joint, sign in zip(joints, signs) if sign < 0]
        turned = [
            block._replace(b=(block.b + block.known) * np.array(signs) - block.known)
            for block in blocks
        ]
        words = f"{' and '.join(wrong)} {'has' if len(wrong) == 1 else 'have'} the wrong sign (or the angle has)"
        mend = format_remapping(sources, {name: (name, -1.0) for name in wrong})
        yield AssignmentTrial(
            compute_bounded_misfit(DesignBlocks(rows, tuple(turned))), words, f"turn it: {mend}"
        )
    for pair in combinations(range(n) if rows.logs else (), 2):
        first, second = (f"tau_{joints[j]}" for j in pair)
        words = f"{first} and {second} hold each other's torque"
        mend = format_remapping(sources, {first: (second, 1.0), second: (first, 1.0)})
        yield AssignmentTrial(
            compute_bounded_misfit(
                compute_blocks(reorder_channels(rows, exchange_places(n, *pair), ("tau",)))
            ),
            words,
            f"exchange them: {mend}",
        )


def try_orders(blocks: DesignBlocks) -> Iterator[AssignmentTrial]:
    """Yield exchanges of two whole joints that least squares explains far better than theirs, where there are logs."""
    rows = blocks.design
    joints = blocks.design.rig.joints
    if not rows.logs:
        return
    given = compute_free_misfit(blocks)
    beginnings = replace(rows, logs=tuple(map(take_beginning, rows.logs)))
    for order in (
        exchange_places(rows.rig.n, *pair) for pair in combinations(range(rows.rig.n), 2)
    ):
        put = compute_blocks(reorder_channels(beginnings, order, JOINT_CHANNELS))
        if compute_free_misfit(put) < LEAST_IMPROVEMENT * given:
            places = [(joints[j], joints[k]) for j, k in enumerate(order) if j != k]
            to, of = (",".join(side) for side in zip(*places))
            words = f"{', '.join(joint for joint, _ in places)} have changed places"
            yield AssignmentTrial(compute_bounded_misfit(put), words, f"--map {to}={of}", True)


def correlate_with_given(blocks: DesignBlocks) -> Array:
    """``<b τ> / sqrt(<b²> <τ²>)``, (n,): torques against what the given rig asks for."""
    beta = blocks.design.mixing @ blocks.design.rig.phi
    expected = np.concatenate([block.A[:, :, : len(beta)] @ beta for block in blocks])
    given = np.concatenate([block.b for block in blocks])
    norms = np.linalg.norm(expected, axis=0) * np.linalg.norm(given, axis=0)
    return np.asarray(np.sum(expected * given, axis=0) / np.maximum(norms, 1e-300))


def list_sign_patterns(n: int) -> list[tuple[int, ...]]:
    """Signs of n columns: each one turned alone, then all of them."""
    return list(
        dict.fromkeys(
            [*(tuple(-1 if k == j else 1 for k in range(n)) for j in range(n)), (-1,) * n]
        )
    )


def exchange_places(n: int, i: int, k: int) -> tuple[int, ...]:
    """Return the order of n joints in which two are exchanged."""
    return tuple({i: k, k: i}.get(j, j) for j in range(n))


def reorder_channels(rows: Design, order: Sequence[int], channels: Sequence[str]) -> Design:
    """Return the rows of logs in which joint j has these channels of ``order[j]``."""
    logs = []
    for log in rows.logs:
        columns: dict[str, Any] = {
            name: x[:, list(order)] for name, x in log.channels.items() if name in channels
        }
        logs.append(replace(log, **columns))
    return replace(rows, logs=tuple(logs))


def compute_free_misfit(blocks: DesignBlocks) -> float:
    """Share of the torque that least squares does not explain, with bodies of any kind, rms over the joints."""
    if not blocks:
        return 1.0
    factors = factor_in_shares(blocks)
    theta = solve_factors(factors, np.ones(len(factors))).theta
    return float(np.sqrt(np.sum((factors @ np.append(theta, -1.0)) ** 2) / len(factors)))


def factor_in_shares(blocks: DesignBlocks) -> Array:
    """Triangular factors of each joint's [A b], in shares of its torque's rms, (n, k + 1, k + 1)."""
    size = np.sqrt(np.maximum(count_effective_rows(blocks), 1.0)) * compute_torque_size(blocks)
    return np.asarray(factor_rows(blocks) / size[:, None, None])


def compute_bounded_misfit(blocks: DesignBlocks) -> float:
    """Share of the torque that the best bodies that can exist do not explain, rms over the joints.

    Errors count in shares of each joint's torque and not of its noise: a fit that is wrong by thousands of deviations
    would take a hundred times as long to settle, for a figure that is not needed to so many digits.
    """
    factors = factor_in_shares(blocks) / ERROR_RESOLUTION
    try:
        phi, friction = fit_bounded_bodies(
            blocks.design, factors.reshape(-1, factors.shape[2]), LEANT_WEIGHTS
        )
    except np.linalg.LinAlgError:  # so far from all bodies that numbers end: they explain nothing
        return 1.0
    theta = np.concatenate([blocks.design.mixing @ phi, friction, [-1.0]])
    return float(ERROR_RESOLUTION * np.sqrt(np.sum((factors @ theta) ** 2) / len(factors)))


def compute_torque_size(blocks: Sequence[Block]) -> Array:
    """Rms of each joint's torque where it is not masked out, N m, (n,); of one that nothing drives some of others'."""
    b, share = (
        np.concatenate([getattr(block, name) for block in blocks]) for name in ("b", "share")
    )
    rms = np.sqrt(np.sum(b**2, axis=0) / np.maximum(np.sum(share**2, axis=0), 1e-300))
    return np.asarray(np.maximum(rms, max(UNDRIVEN * float(rms.max()), 1e-300)))
