"""The body that carries the camera: what of its ten parameters shows, and what its URDF states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimbal_pin.effects.rig_effect import payload
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.reduction import Reduction, scan, stacked
from gimbal_pin.regressor import SCAN
from gimbal_pin.rig import PHI, Rig
from gimbal_pin.rows import camera_body, over_phi


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
