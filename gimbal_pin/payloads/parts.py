"""What both identifications are made of: rows of one payload, and maps from all parameters to a camera's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.estimators import Estimate
from gimbal_pin.identification import split, units, within
from gimbal_pin.log import Array, Log
from gimbal_pin.model import friction_effects
from gimbal_pin.payloads.camera import Camera
from gimbal_pin.payloads.carried import Carried, stated
from gimbal_pin.reduction import Reduction
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Block, Filtering, Rows, kept


def parted(
    rig: Rig, logs: Sequence[Log], holdout: str | None, filters: Filtering, reduction: Reduction
) -> tuple[Rows, Sequence[Block] | None, str]:
    """Return training rows, held-out blocks, and how they were parted: every log at two thirds."""
    if holdout not in (None, "none", "last-third"):
        raise UsageError("--holdout", f"cannot be '{holdout}' for several payloads", "use last-third or none")
    for log in logs:
        within(log, filters)
    train, test, how = split(logs, holdout or "last-third", filters)
    rows = Rows(rig, reduction, friction_effects(rig.joints), train, filters)
    return rows, kept(replace(rows, logs=test)) if test else None, how


def rigid(block: Block, own: Carried) -> Array:
    """Torque per parameter of the camera, (m, n, r): the base columns hold it already, filtered and masked."""
    return np.asarray(block.A[:, :, : len(own.columns)] @ own.columns)


def chosen(own: Carried, place: int, count: int, width: int) -> Array:
    """Map from all parameters to those of the gimbal with camera `place`, (width, width + r (count - 1))."""
    base, size = own.columns.shape
    out = np.zeros((width, width + size * (count - 1)))
    out[:, :width] = np.eye(width)
    if place:
        out[:base, width + size * (place - 1) : width + size * place] = own.columns
    return out


def mapped(estimate: Estimate, map_: Array) -> Estimate:
    """Return an estimate of ``M theta``."""
    return replace(estimate, theta=map_ @ estimate.theta, covariance=map_ @ estimate.covariance @ map_.T)


def change(size: int, place: int, width: int, total: int) -> Array:
    """Map from all parameters to the change that camera `place` makes, (size, total); zero for the reference."""
    out = np.zeros((size, total))
    if place:
        out[:, width + size * (place - 1) : width + size * place] = np.eye(size)
    return out


def camera(own: Carried, reference: Rig, mounted: Rig, theta: Array, covariance: Array, pick: Array) -> Camera:
    """Return the mounted camera: the reference's stated parameters and the change."""
    base, urdf = own.shown(stated(reference)), own.shown(stated(mounted))
    leading = [own.reduction.names[k].rsplit(".", 1)[1] for k in own.reduction.independent]
    return Camera(own.reduction.base_names, units(leading), base + pick @ theta, pick @ covariance @ pick.T, urdf)
