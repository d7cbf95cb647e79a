"""A new camera on a known gimbal: ten seconds of motion do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.dynamics.model import Estimated, Model
from gimbal_pin.dynamics.reduction import Reduction, reduce
from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.channel_assignment import check_wiring
from gimbal_pin.estimation.estimators import Estimator, weighted
from gimbal_pin.estimation.identification import assembled, check_seen, faults
from gimbal_pin.estimation.payloads.camera import BARE, Several
from gimbal_pin.estimation.payloads.parts import Carried, camera, change, chosen, mapped, parted, rigid
from gimbal_pin.estimation.rows import Block, Filtering, Rows, kept
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig


def identify_new(
    rig: Rig,
    logs: Sequence[Log],
    known: Model,
    *,
    estimator: Estimator = weighted,
    holdout: str | None = None,
    filtering: Filtering | None = None,
) -> Several:
    """Estimate a new camera on a known gimbal: those of its parameters that show, everything else as it is known.

    ``gamma = argmin ‖tau - A theta - A_c gamma‖``; the covariance holds what is not known of theta.

    Args:
        rig: The gimbal with the new camera.
        logs: Some 10 s of motion.
        known: A model that `identify` wrote, of the gimbal with another camera.
        estimator: Blocks → `Estimate`.
        holdout: As for `identify`; None: "none", for there is little to hold out.
        filtering: Cutoff and alignment.

    Raises:
        UsageError: The known model was not identified, or holds effects on top of friction.
        DataError: The logs are too short, or do not show the camera.
        LogError: A torque has the wrong sign, or two have changed places, see `channel_assignment.check_wiring`.
    """
    filters, reduction = filtering or Filtering(), reduce(rig)
    own, rows, (tested, how) = fresh(rig, logs, known, holdout or "none", filters, reduction)
    theta, spread = estimated(known).theta, estimated(known).covariance
    blocks = kept(rows)
    mine = [block._replace(A=rigid(block, own), b=block.b - block.A @ theta) for block in blocks]
    found = estimator(mine)
    # Against the whole torque: a camera that is as the known one leaves none of its own.
    heard = [part._replace(b=block.b) for part, block in zip(mine, blocks)]
    check_seen(rows.logs[0].name, own.reduction.base_names, heard, found)
    G = -sensitivity(mine, blocks, found.residual_std)
    both = np.concatenate([theta, found.theta])
    covariance = np.block([[spread, spread @ G.T], [G @ spread, found.covariance + G @ spread @ G.T]])
    joint = replace(found, theta=both, covariance=covariance)
    identified = assembled(rows, blocks, mapped(joint, chosen(own, 1, 2, len(theta))), tested, how)
    check_wiring(blocks, identified.estimate)
    identified = replace(identified, faults=faults(rig, logs))
    name = rig.payload or "camera"
    size = own.columns.shape[1]
    one = camera(own, known.rig, rig, joint.theta, joint.covariance, change(size, 1, len(theta), len(both)))
    return Several({name: identified}, {name: one}, known.rig.payload or BARE)


def fresh(
    rig: Rig, logs: Sequence[Log], known: Model, holdout: str, filters: Filtering, reduction: Reduction
) -> tuple[Carried, Rows, tuple[Sequence[Block] | None, str]]:
    """Return what a new camera's fit needs, checked."""
    rows, tested, how = parted(rig, logs, holdout, filters, reduction)
    if rows.names != estimated(known).names:
        raise UsageError("--known", "holds other parameters than this rig", f"identify {rig.name} with another camera")
    return Carried.of(rig, reduction), rows, (tested, how)


def estimated(known: Model) -> Estimated:
    """Return what is known of a model's parameters; `UsageError` if it was not identified."""
    if known.estimated is None:
        raise UsageError("--known", "holds no uncertainty", "give a model that 'gimbal-pin identify -o' wrote")
    return known.estimated


def sensitivity(mine: Sequence[Block], blocks: Sequence[Block], residual_std: Array) -> Array:
    """``(A_cᵀWA_c)⁻¹ A_cᵀWA``: how the camera's parameters follow the known ones, (r, k), W from the residuals."""
    weight = 1.0 / np.maximum(residual_std, 1e-300) ** 2
    own = sum(np.einsum("tjk,j,tjl->kl", a.A, weight, a.A) for a in mine)
    both = sum(np.einsum("tjk,j,tjl->kl", a.A, weight, b.A) for a, b in zip(mine, blocks))
    return np.asarray(np.linalg.lstsq(np.asarray(own), np.asarray(both), rcond=1e-12)[0])
