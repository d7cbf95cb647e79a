"""What the joint torques of a rig can show: base parameters with friction counted in (THESIS 4.33 and its table)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gimbal_pin.model import friction_effects
from gimbal_pin.reduction import reduce, written
from gimbal_pin.rig import Rig


@dataclass(frozen=True)
class Base:
    """The result of `base`.

    Attributes:
        rig: The rig's name.
        parameters: Number of inertial and friction parameters.
        terms: Per base parameter, the parameters that it sums and their factors.
        unidentifiable: Parameters without any trace in the torques.
    """

    rig: str
    parameters: int
    terms: tuple[Mapping[str, float], ...]
    unidentifiable: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The base parameters, written as sums."""
        return tuple(written(terms) for terms in self.terms)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds (CONTRACT, `base`)."""
        return {
            "schema": 1,
            "rig": self.rig,
            "parameters": self.parameters,
            "identifiable": len(self.terms),
            "unidentifiable": list(self.unidentifiable),
            "base": [{"name": written(terms), "terms": dict(terms)} for terms in self.terms],
        }


def base(rig: Rig, diagonal: bool = False) -> Base:
    """Return the base parameters of a rig, of full inertias or of diagonal ones without masses as in the thesis."""
    reduction = reduce(rig, diagonal)
    friction = [f"{effect.joint}.{c.name}" for effect in friction_effects(rig.joints) for c in effect.coefficients]
    return Base(
        rig=rig.name,
        parameters=len(reduction.names) + len(friction),
        terms=(*reduction.terms, *({name: 1.0} for name in friction)),
        unidentifiable=reduction.unidentifiable,
    )
