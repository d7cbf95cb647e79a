"""Torque of terms on floats, joint by joint: what the simulation takes off the motors' torque at every stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from gimbal_pin.effects.base import AMBIENT, EffectMemory, Sample, Term
from gimbal_pin.log.log import Array

EffectMemories = tuple[EffectMemory, ...]
make_sample = partial(tuple.__new__, Sample)
"""A `Sample` of its ten entries: a named tuple's own way is three times as long, and this runs at every stage."""


class Resistance:
    """``net = tau - sum of terms``, at any stage of a step.

    The affine terms' coefficients are read off their bases once: on most rigs that is all there is, and costs two
    products a joint. The others are evaluated sample by sample.

    Attributes:
        start: What the terms with a memory remember at rest.
        dry_joints: Joints that can stick.
        warm: Temperature of each motor, °C.
        weighed: Whether a term may read the joint's weight.
    """

    def __init__(self, by_joint: Sequence[Sequence[Term]]) -> None:
        """Take the terms that act on each joint apart."""
        affine = [[term for term in terms if term.effect.affine] for terms in by_joint]
        self.constant = [
            _sum_torques(terms, Sample(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)) for terms in affine
        ]
        self.per_slide = [
            _sum_torques(terms, Sample(0.0, 0.0, 0.0, 0.0, 1.0, 0.0)) - zero
            for terms, zero in zip(affine, self.constant)
        ]
        self.per_rate = [
            _sum_torques(terms, Sample(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)) - zero
            for terms, zero in zip(affine, self.constant)
        ]
        self.rest = [
            (j, [t for t in terms if not t.effect.affine]) for j, terms in enumerate(by_joint)
        ]
        self.rest = [(j, terms) for j, terms in self.rest if terms]
        self.dry = [
            [t for t in terms if t.effect.dry and not t.effect.affine] for terms in by_joint
        ]
        self.dry_joints = [
            j for j, terms in enumerate(by_joint) if any(t.effect.dry for t in terms)
        ]
        keeping = [
            (j, term) for j, terms in self.rest for term in terms if term.effect.start() is not None
        ]
        self.keeping = keeping
        self.slots = {id(term): slot for slot, (_, term) in enumerate(keeping)}
        self.torques = [
            (j, [(term.torque, self.slots.get(id(term))) for term in terms])
            for j, terms in self.rest
        ]
        self.weighed = any(term.effect.weighed for terms in by_joint for term in terms)
        self.warm = [AMBIENT] * len(by_joint)
        self.start: EffectMemories = tuple(term.effect.start() or 0.0 for _, term in keeping)

    def left(self, tau: Sequence[float], slide: Sequence[float]) -> list[float]:
        """Torque left of `tau`, N m, by the part of the affine terms that is the same at every stage of a step."""
        return [u - c - s * k for u, c, s, k in zip(tau, self.constant, slide, self.per_slide)]

    def evolved(
        self, memory: EffectMemories, before: Sequence[float], after: Sequence[float]
    ) -> EffectMemories:
        """Return the memory after the joints have moved from angles `before` to `after`, rad."""
        return tuple(
            [t.effect.evolve(m, after[j] - before[j]) for m, (j, t) in zip(memory, self.keeping)]
        )

    def warmed(self, memory: EffectMemories, tau: Sequence[float], dt: float) -> EffectMemories:
        """Return the memory after the motors have given the torques `tau`, N m, for `dt` s."""
        return tuple([t.effect.warmed(m, tau[j], dt) for m, (j, t) in zip(memory, self.keeping)])

    def remembered(self, along: Callable[[int], Sample]) -> list[Array]:
        """What the memories hold at consecutive samples of a joint each, from rest and cold: (N,) or (k, N)."""
        return [term.effect.remembered(along(j)) for j, term in self.keeping]

    def take(
        self,
        net: list[float],
        t: float,
        q: Sequence[float],
        v: Sequence[float],
        slide: Sequence[float],
        tau: Sequence[float],
        memory: EffectMemories,
        weight: Sequence[float],
    ) -> None:
        """Take the torque of the terms that are not affine, N m, off `net`, given the memory at this stage."""
        for j, torques in self.torques:
            taken = 0.0
            for torque, slot in torques:
                held = None if slot is None else memory[slot]
                at = make_sample(
                    (
                        t,
                        q[j],
                        v[j],
                        0.0,
                        slide[j],
                        tau[j],
                        self.warm[j],
                        held,
                        weight[j],
                        None,
                    )
                )
                taken += float(torque(at))
            net[j] -= taken

    def level(
        self,
        t: float,
        q: float,
        tau: float,
        j: int,
        way: float,
        memory: EffectMemories = (),
        weight: float = 0.0,
    ) -> float:
        """Dry friction with which joint `j` can hold against a torque in the direction `way`, N m."""
        held = 0.0
        for term in self.dry[j]:
            slot = self.slots.get(id(term)) if memory else None
            known = None if slot is None else memory[slot]
            held += float(
                term.torque(Sample(t, q, 0.0, 0.0, way, tau, self.warm[j], known, weight=weight))
            )
        return self.per_slide[j] + way * held


def _sum_torques(terms: Sequence[Term], at: Sample) -> float:
    """Torque of some terms at one sample, N m."""
    return float(sum(term.torque(at) for term in terms))
