"""What both identifications are made of: the camera's body, rows of one payload, and maps to a camera's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.dynamics.model import friction_effects
from gimbal_pin.dynamics.reduction import Reduction, scan, stacked, units
from gimbal_pin.dynamics.regressor import SCAN
from gimbal_pin.effects.rig_effect import payload
from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.estimators import Estimate
from gimbal_pin.estimation.identification import split, within
from gimbal_pin.estimation.payloads.camera import Camera
from gimbal_pin.estimation.rows import Block, Filtering, Rows, camera_body, kept, over_phi
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import PHI, Rig


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


@dataclass(frozen=True, eq=False)
class Carried:
    """The parameters of the body that carries the camera, as far as joint torques show them.

    Attributes:
        body: Which body, from 0.
        reduction: Its ten parameters' reduction: what of them shows.
        columns: K_c: base parameters per independent one of them, (b, r).
    """

    body: int
    reduction: Reduction
    columns: Array

    @staticmethod
    def of(rig: Rig, reduction: Reduction) -> Carried:
        """Return what shows of the camera's body if all the others are known."""
        body = camera_body(rig)
        matrix, names = stacked(rig)
        mine = [k for k, name in enumerate(names) if name.rsplit(".", 1)[0] == rig.links[body]]
        own = scan(matrix[:, mine], tuple(f"camera.{names[k].rsplit('.', 1)[1]}" for k in mine))
        places = [10 * body + PHI.index(SCAN[k]) for k in own.independent]
        return Carried(body, own, over_phi(rig, reduction)[:, places])

    def shown(self, phi: Array) -> Array:
        """What of ten parameters shows, (r,)."""
        return np.asarray(self.reduction.mixing @ phi[[PHI.index(symbol) for symbol in SCAN]])


def stated(rig: Rig) -> Array:
    """Ten parameters of the payload as its URDF states it, about the joint; zero where nothing is mounted."""
    try:
        return np.array(payload(rig)[1].toDynamicParameters())
    except UsageError:
        return np.zeros(10)
