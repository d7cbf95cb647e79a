"""What of a URDF's inertias is wrong and matters: the rest is said and passed over; the nearest that can be is offered.

Joints feel the sum of the links that are fixed to each other, and nothing of those that no joint moves. Of a link that
turns about one direction only they feel the inertia about that direction alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

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

Body = tuple[float, np.ndarray, np.ndarray]
"""Mass, centre of mass and inertia about it, as `urdf.inertials` gives them."""


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


def moved(robot: etree._Element) -> set[str]:
    """Return the links that a joint moves."""
    starts = [j.find("child").get("link") for j in robot.findall("joint") if j.get("type") in MOVABLE]
    return {link for start in starts for link in urdf.reached(robot, start)}


def cleared(robot: etree._Element, place: str, carried: bool = False) -> list[str]:
    """Take out, in place, the ``<inertial>`` of links that weigh nothing, and those of links at rest that cannot be.

    `carried`: whether all of it moves, as a payload does.

    Returns:
        A sentence on each kind.

    Raises:
        RigError: The inertial of a link that moves cannot even be mended.
    """
    moving, empty, idle = moved(robot), list[str](), list[str]()
    for link in robot.findall("link"):
        name, inertial = link.get("name"), link.find("inertial")
        if inertial is None:
            continue
        if weightless(inertial):
            empty.append(name)
        elif carried or name in moving:
            check_inertial(link, place)
            continue
        elif sound(link, place):
            continue
        else:
            idle.append(name)
        link.remove(inertial)
    kinds = (
        ("no mass and no inertia, so its <inertial> counts for nothing", empty),
        ("no joint moves it, so its inertia, which no body has, does not matter", idle),
    )
    return [f"{what}: {listed(links)}" for what, links in kinds if links]


def sound(link: etree._Element, place: str) -> bool:
    """Tell whether a link's inertial is one that a body can have."""
    try:
        check_inertial(link, place)
    except RigError:
        return False
    return broken_rule(link) is None


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
    rules = broken(text)
    if not rules:
        return text, []
    bodies = urdf.inertials(text)
    nearest = {link: with_inertia(bodies[link], nearest_inertia(*bodies[link][::2])) for link in rules}
    return urdf.with_inertials(text, nearest), [f"{link} {rule}: now the nearest one" for link, rule in rules.items()]


def with_inertia(body: Body, inertia: np.ndarray) -> Body:
    """Return a body with another inertia about its centre of mass."""
    return body[0], body[1], inertia


def felt(text: str, model: pin.Model, place: str) -> tuple[str, list[str]]:
    """Return a URDF with the same torques whose bodies can be, and a sentence on each inertia that breaks a rule.

    Raises:
        RigError: A link has an inertia that breaks a rule, and a joint feels it.
    """
    rules = broken(text)
    if not rules:
        return text, []
    bodies, summed, kept = urdf.inertials(text), list[str](), dict[str, Body]()
    for link, R, index in placed(model, rules):
        if rule(np.array(model.inertias[index].inertia)) is None:
            summed.append(link)
            continue
        mass, _, inertia = bodies[link]
        nearest, ways = nearest_inertia(mass, inertia), [R.T @ way for way in directions(model, index)]
        share = (ways[0] @ inertia @ ways[0]) / (ways[0] @ nearest @ ways[0]) if ways else 1.0
        if len(ways) > 1 or not share > 0:
            mend = "recompute it, or take the nearest that can be: 'gimbal-pin check RIG --mend OUT.urdf'"
            raise RigError(f"{place}: link '{link}'", rules[link], mend)
        kept[link] = with_inertia(bodies[link], share * nearest)
    said = [f"{link} {rules[link]}; it counts with the links fixed to it, and their sum is sound" for link in summed]
    said += [f"{link} {rules[link]}; what its joint feels of it is kept, the rest is the nearest" for link in kept]
    return (urdf.with_inertials(text, kept) if kept else text), said


def placed(model: pin.Model, links: Mapping[str, str]) -> Iterator[tuple[str, np.ndarray, int]]:
    """Yield those of the links that move: name, rotation from its axes to its joint's, and the joint's number."""
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in links and frame.parentJoint:
            yield frame.name, frame.placement.rotation, int(frame.parentJoint)


def directions(model: pin.Model, joint: int) -> list[np.ndarray]:
    """Return directions that a joint's body turns about, in its own axes: none, the one, or two that differ."""
    data = model.createData()
    columns = [model.joints[j].idx_v for j in model.supports[joint] if j]
    jacobian = pin.computeJointJacobians(model, data, np.zeros(model.nq)).reshape(6, model.nv)  # one joint's is flat
    turning = jacobian[3:, columns].T @ data.oMi[joint].rotation
    ways = [way for way in turning if np.linalg.norm(way) > 0.5]
    other = [way for way in ways[1:] if np.linalg.norm(np.cross(way, ways[0])) > PARALLEL]
    return ways[:1] + other[:1]
