"""What is known of cameras on one gimbal, and how it is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gimbal_pin.estimation.balance import reported
from gimbal_pin.estimation.identification import Identified, refitted
from gimbal_pin.log.log import Array

BARE = "none"
"""The payload that weighs nothing: where there is a log of it, the others are measured from it."""


@dataclass(frozen=True, eq=False)
class Camera:
    """What joint torques show of one camera.

    Attributes:
        names: Parameters of the camera that show, regrouped; about the joint that carries it, in that joint's frame.
        units: Their SI units.
        value: Estimate, (r,).
        covariance: Its covariance, (r, r); zero where it was not estimated, but taken as its URDF says.
        urdf: What its URDF says, (r,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    covariance: Array
    urdf: Array

    @property
    def std(self) -> Array:
        """Standard deviations, (r,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def mass(self) -> float | None:
        """The identified mass, kg; None where it was not estimated, shows only in sums, or is that of nothing."""
        rows = zip(self.names, self.value.tolist(), self.std.tolist())
        return next((x for name, x, std in rows if name.endswith(".m") and " " not in name and std and x > 0), None)

    def to_dict(self) -> list[dict[str, Any]]:
        """Return rows of name, value, std, unit and the URDF's value."""
        rows = zip(self.names, self.value.tolist(), self.std.tolist(), self.units, self.urdf.tolist())
        return [{"name": n, "value": x, "std": s, "unit": u, "urdf": given} for n, x, s, u, given in rows]


@dataclass(frozen=True, eq=False)
class Several:
    """The result of `identify_several` and of `identify_new`.

    Attributes:
        identified: Payload → model of the gimbal with it; the gimbal's own parameters and friction are the same in all.
        cameras: Payload → its own parameters.
        reference: The payload whose URDF the cameras' parameters stand on: `BARE`, or the first.
    """

    identified: Mapping[str, Identified]
    cameras: Mapping[str, Camera]
    reference: str

    @property
    def first(self) -> Identified:
        """The gimbal with the reference, or with the first payload where that has no log."""
        return self.identified.get(self.reference, next(iter(self.identified.values())))

    def __repr__(self) -> str:
        """A few lines per camera: what was estimated, and how well it predicts."""
        return "\n".join([*(repr(one) for one in self.identified.values()), self.sentence])

    def refitted(self, whole: Several) -> Several:
        """Return an estimate from all data with the held-out accuracy of this one, which had not seen all of it."""
        each = {name: refitted(self.identified[name], one) for name, one in whole.identified.items()}
        return replace(whole, identified=each)

    @property
    def sentence(self) -> str:
        """Say what the cameras' parameters stand on."""
        if self.reference == BARE:
            return "the cameras' own parameters are measured against the gimbal without any"
        return f"the cameras' own parameters stand on {self.reference} being as its URDF says: add a log of '@{BARE}'"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds (CONTRACT, `identify`): the reference's, and every payload's under `payloads`."""
        cameras = {name: one.to_dict() for name, one in self.cameras.items()}
        each = {
            name: {**reported(one, self.cameras[name].mass), "camera": cameras[name]}
            for name, one in self.identified.items()
        }
        first = each.get(self.reference, next(iter(each.values())))
        logs = [log for one in self.identified.values() for log in one.logs]
        return {**first, "logs": logs, "reference": self.reference, "note": self.sentence, "payloads": each}
