"""What the joint torques of a rig can show: base parameters with friction counted in (thesis 4.33 and its table)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from gimbal_pin.dynamics.model import build_stated_effects
from gimbal_pin.dynamics.reduction import Reduction, format_sum, reduce_parameters
from gimbal_pin.log.platform import BASE_MOTIONS, BaseMotion
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True)
class Base(Record):
    """The result of `compute_base`.

    Attributes:
        rig: The rig's name.
        parameters: Number of parameters: the bodies', friction, and what else the rig states.
        terms: Per base parameter, the parameters that it sums and their factors.
        unidentifiable: Parameters without any trace in the torques.
        moving: Motion of the base → the base parameters that it adds to those of a base that stands upright.
    """

    rig: str
    parameters: int
    terms: tuple[Mapping[str, float], ...]
    unidentifiable: tuple[str, ...]
    moving: Mapping[BaseMotion, tuple[Mapping[str, float], ...]]

    ROWS: ClassVar[str] = "base"
    __repr__ = brief

    @property
    def names(self) -> tuple[str, ...]:
        """The base parameters, written as sums."""
        return tuple(format_sum(terms) for terms in self.terms)

    def to_dict(self) -> dict[str, Any]:
        """Return what `base --json` writes."""
        return {
            "schema": 1,
            "rig": self.rig,
            "parameters": self.parameters,
            "identifiable": len(self.terms),
            "unidentifiable": list(self.unidentifiable),
            "base": _name_sums(self.terms),
            "moving_base": {
                motion: {"identifiable": len(self.terms) + len(added), "adds": _name_sums(added)}
                for motion, added in self.moving.items()
            },
        }


def _name_sums(terms: Sequence[Mapping[str, float]]) -> list[dict[str, Any]]:
    """Return base parameters with their names, as JSON holds them."""
    return [{"name": format_sum(one), "terms": dict(one)} for one in terms]


def compute_base(rig: Rig, diagonal: bool = False) -> Base:
    """Return the base parameters of a rig, of full inertias or of diagonal ones without masses as in the thesis.

    `build_stated_effects` follow: friction, and rotors and constant torques where the rig asks for them.
    """
    reduction = reduce_parameters(rig, diagonal)
    moving = {
        motion: _find_added_sums(reduction, reduce_parameters(rig, diagonal, motion))
        for motion in BASE_MOTIONS[1:]
    }
    others = [
        f"{effect.joint}.{c.name}"
        for effect in build_stated_effects(rig, reduction)
        for c in effect.coefficients
    ]
    return Base(
        rig=rig.name,
        parameters=len(reduction.names) + len(others) + sum(map(len, reduction.grouped)),
        terms=(*reduction.terms, *({name: 1.0} for name in others)),
        unidentifiable=reduction.unidentifiable,
        moving=moving,
    )


def _find_added_sums(fixed: Reduction, moving: Reduction) -> tuple[Mapping[str, float], ...]:
    """Return the base parameters that a motion of the base adds: each is led by a column that was not there before."""
    bodies = tuple(
        terms for j, terms in zip(moving.independent, moving.terms) if j not in fixed.independent
    )
    return bodies + tuple(
        {f"{joint}.Ia": 1.0} for joint in moving.rotors if joint not in fixed.rotors
    )
