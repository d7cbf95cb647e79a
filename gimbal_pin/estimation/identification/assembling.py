"""From estimated parameters to a model, its accuracy and the nearest bodies that can exist."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.dynamics.model import Estimated, Model
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import columns
from gimbal_pin.estimation.bodies import TRUST
from gimbal_pin.estimation.estimators import Estimate
from gimbal_pin.estimation.identification.identified import Identified
from gimbal_pin.estimation.identification.judging import accuracy
from gimbal_pin.estimation.rows import Block, Rows
from gimbal_pin.log.log import Array
from gimbal_pin.rig.consistency import Consistent, likeliest, nearest
from gimbal_pin.rig.rig import Rig


def assembled(
    rows: Rows,
    blocks: Sequence[Block],
    estimate: Estimate,
    tested: Sequence[Block] | None,
    how: str,
    trust: float = TRUST,
) -> Identified:
    """Return what is known once the parameters of some rows are estimated: model, accuracy, nearest physical bodies.

    Args:
        rows: The training rows.
        blocks: Their blocks.
        estimate: Parameters in the order of `rows.names`.
        tested: Blocks that were held out, or None.
        how: How they were parted.
        trust: Relative standard deviation of the URDF's masses, see `bodies`.
    """
    rig, model = rows.rig, to_model(rows, estimate)
    held_out = None if tested is None else accuracy(rig.joints, tested, estimate.theta, how)
    consistent, shift = nearest_physical(rows, estimate, trust)
    change = rms([block.A[:, :, : len(shift)] @ shift for block in blocks])
    return Identified(
        model=model,
        reduction=rows.reduction,
        estimate=estimate,
        names=rows.names,
        units=rows.units,
        train=accuracy(rig.joints, blocks, estimate.theta, "training part"),
        held_out=held_out,
        consistent=consistent,
        torque_change=dict(zip(rig.joints, change.tolist())),
        logs=tuple(log.name for log in rows.logs),
        filtering=rows.filtering,
        given=rig.phi,
        trust=trust,
    )


def to_model(rows: Rows, estimate: Estimate) -> Model:
    """Return the model with these parameters: RNEA and regressor then predict the same torque.

    Bodies that were fitted are taken as they are, else those of `Rows.phi`; `consistency.nearest` has physical ones.
    """
    rig, width = rows.rig, len(rows.reduction.independent)
    phi = rows.phi(estimate.theta[:width]) if estimate.phi is None else estimate.phi
    known = Estimated(rows.names, rows.units, estimate.theta, estimate.covariance)
    return Model(rig.with_phi(phi), rows.terms(estimate.theta), known)


def nearest_physical(rows: Rows, estimate: Estimate, trust: float) -> tuple[Consistent, Array]:
    """Return the most likely bodies, how far off the nearest are, and the change in base parameters, (b,)."""
    width = len(rows.reduction.independent)
    if estimate.phi is not None:
        return Consistent(estimate.phi, 0.0), np.zeros(width)
    told = rows.rig.phi, rows.mixing, estimate.theta[:width], estimate.covariance[:width, :width]
    phi = likeliest(*told, trust)
    return Consistent(phi, nearest(*told).distance), rows.mixing @ phi - estimate.theta[:width]


def rms(parts: Sequence[Array]) -> Array:
    """Root mean square over the rows of all parts, per joint, (n,)."""
    return np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))


def given_beta(rig: Rig, reduction: Reduction) -> Array:
    """Base parameters of the URDF as it stands, (b,)."""
    return reduction.mixing @ rig.phi[columns(rig)[1]]
