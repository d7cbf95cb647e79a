"""Inertias of a URDF that no body can have: refused where a joint feels them, else replaced by the nearest possible.

Joints feel the sum of the links that are fixed to each other, and no link that no joint moves. Of a link that turns
about one direction only they feel the inertia about that direction alone.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import FEW, RigError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.urdf_checks import MOVABLE, broken_rule, check_inertial, rule, weightless

THIN = 1e-6
"""Least second moment of a mended body per sum of them: a plate a thousandth as thick as it is wide stays regular."""
PARALLEL = 1e-6
"""Largest sine between axes of one direction: with angles written in six digits, as 1.570796, they are that near."""


def nearest_inertia(mass: float, inertia: np.ndarray) -> np.ndarray:
    """Return the inertia about the centre of mass nearest to one that breaks a rule, kg m², (3, 3).

    ``I = tr(Σ) 1 - Σ`` is some body's if the second moments Σ = ∫ r rᵀ dm are positive: those below `THIN` of their sum
    are raised to it, which is the nearest in the Frobenius norm of Σ. Where none is positive it is a point's, and
    becomes that of a sphere of 1 mm: `mass` gives its size.
    """
    values, axes = np.linalg.eigh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    most = values.clip(min=0.0).sum() or 3 * mass * 1e-6 / 5
    sigma = (axes * values.clip(min=THIN * most)) @ axes.T if values.max() > 0 else most / 3 * np.eye(3)
    return np.asarray(np.trace(sigma) * np.eye(3) - sigma)


def cleared(robot: etree._Element, place: str, carried: bool = False) -> list[str]:
    """Remove, in place, the ``<inertial>`` of links without mass, and impossible ones of links at rest.

    `carried`: whether all of it moves, as a payload does.

    Returns:
        A sentence on each kind.

    Raises:
        RigError: The inertial of a link that moves cannot be replaced.
    """
    starts = [j.find("child").get("link") for j in robot.findall("joint") if j.get("type") in MOVABLE]
    moving = {link for start in starts for link in urdf.reached(robot, start)}
    empty, idle = list[str](), list[str]()
    for link in robot.findall("link"):
        name, inertial = link.get("name"), link.find("inertial")
        if inertial is None:
            continue
        if weightless(inertial):
            empty.append(name)
        else:
            try:
                check_inertial(link, place)
            except RigError:
                if carried or name in moving:
                    raise
            else:
                if carried or name in moving or broken_rule(link) is None:
                    continue
            idle.append(name)
        link.remove(inertial)
    kinds = (
        ("no mass and no inertia, so its <inertial> counts for nothing", empty),
        ("no joint moves it, so its inertia, which no body has, does not matter", idle),
    )
    return [f"{what}: {listed(links)}" for what, links in kinds if links]


def listed(names: Iterable[str]) -> str:
    """Return names on a line, the first `FEW` of them."""
    every = list(names)
    return ", ".join(every[:FEW]) + (f" and {len(every) - FEW} more" if len(every) > FEW else "")


def broken(text: str) -> dict[str, str]:
    """Return link → the rule that its inertia breaks."""
    rules = ((link.get("name"), broken_rule(link)) for link in urdf.parse(text, "URDF").findall("link"))
    return {name: rule for name, rule in rules if rule is not None}


def mended(text: str) -> tuple[str, list[str]]:
    """Return a URDF whose inertias that break a rule are the nearest that do not, and a sentence on each."""
    rules, bodies = broken(text), urdf.inertials(text)
    nearest = {link: (*bodies[link][:2], nearest_inertia(*bodies[link][::2])) for link in rules}
    said = [f"{link} {rule}: now the nearest one" for link, rule in rules.items()]
    return (urdf.with_inertials(text, nearest) if nearest else text), said


def felt(text: str, model: pin.Model, place: str) -> tuple[str, list[str]]:
    """Return a URDF with the same torques whose bodies are possible, and a sentence on each inertia that breaks a rule.

    Raises:
        RigError: A link has an inertia that breaks a rule, and a joint feels it.
    """
    rules = broken(text)
    if not rules:
        return text, []
    bodies, summed, kept = urdf.inertials(text), list[str](), dict[str, urdf.Body]()
    for frame in model.frames:
        link, index = frame.name, int(frame.parentJoint)
        if frame.type != pin.FrameType.BODY or link not in rules or not index:
            continue
        if rule(np.array(model.inertias[index].inertia)) is None:
            summed.append(link)
            continue
        mass, _, inertia = bodies[link]
        nearest, ways = (
            nearest_inertia(mass, inertia),
            [frame.placement.rotation.T @ way for way in directions(model, index)],
        )
        share = (ways[0] @ inertia @ ways[0]) / (ways[0] @ nearest @ ways[0]) if ways else 1.0
        if len(ways) > 1 or not share > 0:
            mend = "recompute it, or take the nearest that can be: 'gimbal-pin check RIG --mend OUT.urdf'"
            raise RigError(f"{place}: link '{link}'", rules[link], mend)
        kept[link] = (*bodies[link][:2], share * nearest)
    said = [f"{link} {rules[link]}; it counts with the links fixed to it, and their sum is sound" for link in summed]
    said += [f"{link} {rules[link]}; what its joint feels of it is kept, the rest is the nearest" for link in kept]
    return (urdf.with_inertials(text, kept) if kept else text), said


def directions(model: pin.Model, joint: int) -> list[np.ndarray]:
    """Return directions that a joint's body turns about, in its own axes: at most two, which differ."""
    data = model.createData()
    columns = [model.joints[j].idx_v for j in model.supports[joint] if j]
    jacobian = pin.computeJointJacobians(model, data, np.zeros(model.nq)).reshape(6, model.nv)  # one joint's is flat
    turning = jacobian[3:, columns].T @ data.oMi[joint].rotation
    ways = [way for way in turning if np.linalg.norm(way) > 0.5]
    other = [way for way in ways[1:] if np.linalg.norm(np.cross(way, ways[0])) > PARALLEL]
    return ways[:1] + other[:1]
