"""Inertias that bodies can have: tested, mended where a URDF states others, and written back.

A body exists if its pseudo-inertia ``[[Σ, h], [hᵀ, m]]`` is positive definite (Wensing, Kim and Slotine 2018):
positive mass, and principal inertias that satisfy the triangle inequality strictly. Log-Cholesky parameters reach
these bodies and no others (Rucker and Wensing 2022).

Joints feel the sum of the links that are fixed to each other, and no link that no joint moves. Of a link that turns
about one direction only they feel the inertia about that direction alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import FEW, ModelError, RigError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.types import Array
from gimbal_pin.rig.urdf_checks import MOVABLE, check_inertial, is_weightless, read_inertia

if TYPE_CHECKING:
    from gimbal_pin.rig.rig import Rig

_THIN = 1e-6
"""Least second moment of a mended body per sum of them: a plate a thousandth as thick as it is wide stays regular."""


def pseudo_inertia(phi: Array) -> Array:
    """``[[Σ, h], [hᵀ, m]]`` of one body's ten parameters, (4, 4)."""
    return np.array(pin.PseudoInertia.FromDynamicParameters(np.asarray(phi)).toMatrix())


def is_physical(phi: Array) -> bool:
    """Whether every body of (10 n,) parameters is one that can exist."""
    return all(
        np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0 for body in np.reshape(phi, (-1, 10))
    )


def thicken_flat_body(phi: Array) -> Array:
    """Return a body's parameters, thickened by a millionth if it is flat: log-Cholesky parameters reach no plate."""
    if is_physical(phi):
        return phi
    P = pseudo_inertia(phi)
    thick = P + 1e-6 * max(float(np.trace(P[:3, :3])), 1e-9) * np.diag([1.0, 1.0, 1.0, 0.0])
    out = np.array(pin.PseudoInertia.FromMatrix(thick).toDynamicParameters())
    if not is_physical(out):
        raise ModelError(
            "inertial parameters",
            "of the URDF are not physical",
            "mend them: see 'gimbal-pin check'",
        )
    return out


def describe_broken_rule(inertia: Array) -> str | None:
    """Return which rule an inertia about the centre of mass breaks: it is positive definite, and I₁ + I₂ ≥ I₃."""
    small, middle, large = np.linalg.eigvalsh(inertia)
    if not small > 0:
        return f"has an inertia that is not positive definite (principal {small:.3g} kg m²)"
    if small + middle < large * (1 - 1e-9):
        return f"breaks the triangle inequality: principal inertias {small:.4g} + {middle:.4g} < {large:.4g} kg m²"
    return None


def find_nearest_inertia(mass: float, inertia: Array) -> Array:
    """Return the inertia about the centre of mass nearest to one that breaks a rule, kg m², (3, 3).

    ``I = tr(Σ) 1 - Σ`` is some body's if the second moments Σ = ∫ r rᵀ dm are positive: those below `_THIN` of their
    sum are raised to it, which is the nearest in the Frobenius norm of Σ. Where none is positive it is a point's, and
    becomes that of a sphere of 1 mm: `mass` gives its size.
    """
    values, axes = np.linalg.eigh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    most = values.clip(min=0.0).sum() or 3 * mass * 1e-6 / 5
    sigma = (
        (axes * values.clip(min=_THIN * most)) @ axes.T
        if values.max() > 0
        else most / 3 * np.eye(3)
    )
    return np.asarray(np.trace(sigma) * np.eye(3) - sigma)


def remove_unfelt_inertials(robot: etree._Element, place: str, carried: bool = False) -> list[str]:
    """Remove, in place, the ``<inertial>`` of links without mass, and impossible ones of links at rest.

    `carried`: whether all of it moves, as a payload does.

    Returns:
        A sentence on each kind.

    Raises:
        RigError: The inertial of a link that moves cannot be replaced.
    """
    starts = [
        j.find("child").get("link") for j in robot.findall("joint") if j.get("type") in MOVABLE
    ]
    moving = {link for start in starts for link in urdf.find_reached_links(robot, start)}
    empty = list[str]()
    idle = list[str]()
    for link in robot.xpath("link[inertial]"):
        name = link.get("name")
        inertial = link.find("inertial")
        if is_weightless(inertial, is_fixed=name not in starts):
            empty.append(name)
        elif carried or name in moving:
            check_inertial(link, place)
            continue
        else:
            with suppress(RigError):
                check_inertial(link, place)
                if describe_broken_rule(read_inertia(inertial.find("inertia"))) is None:
                    continue
            idle.append(name)
        link.remove(inertial)
    kinds = (
        ("no mass, so its <inertial> counts for nothing", empty),
        ("no joint moves it, so its inertia, which no body has, does not matter", idle),
    )
    return [f"{what}: {join_names(links)}" for what, links in kinds if links]


def join_names(names: Iterable[str]) -> str:
    """Return names on a line, the first `FEW` of them."""
    every = list(names)
    return ", ".join(every[:FEW]) + (f" and {len(every) - FEW} more" if len(every) > FEW else "")


def mend_inertias(text: str, model: pin.Model, place: str, every: bool) -> tuple[str, list[str]]:
    """Return a URDF whose bodies are possible, and a sentence on each inertia that breaks a rule.

    The joints' torques stay the same, unless `every` such inertia is to become the nearest that breaks none.

    Raises:
        RigError: A link has an inertia that breaks a rule, and a joint feels it.
    """
    stated = urdf.parse_robot(text, place).xpath("link/inertial/inertia")
    rules = {
        one.getparent().getparent().get("name"): describe_broken_rule(read_inertia(one))
        for one in stated
    }
    bodies = urdf.read_inertials(text)
    mended = dict[str, urdf.LinkInertia]()
    said = list[str]()
    for link, rule in rules.items():
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        joint = int(frame.parentJoint)
        share = 1.0
        mend = ": now the nearest one"
        if rule is None or not (joint or every):
            continue
        mass, center, inertia = bodies[link]
        nearest = find_nearest_inertia(mass, inertia)
        if not every:
            if describe_broken_rule(np.array(model.inertias[joint].inertia)) is None:
                said.append(
                    f"{link} {rule}; it counts with the links fixed to it, and their sum is sound"
                )
                continue
            ways = [
                frame.placement.rotation.T @ way for way in _find_turning_directions(model, joint)
            ]
            share = (ways[0] @ inertia @ ways[0]) / (ways[0] @ nearest @ ways[0]) if ways else 1.0
            if len(ways) > 1 or not share > 0:
                how = "recompute it, or take the nearest that can be: 'gimbal-pin check RIG --mend OUT.urdf'"
                raise RigError(f"{place}: link '{link}'", rule, how)
            mend = "; what its joint feels of it is kept, the rest is the nearest"
        mended[link] = (mass, center, share * nearest)
        said.append(f"{link} {rule}{mend}")
    return (urdf.replace_inertials(text, mended) if mended else text), said


def _find_turning_directions(model: pin.Model, joint: int) -> list[Array]:
    """Return directions that a joint's body turns about, in its own axes: at most two, which differ.

    Axes with angles in six digits, as 1.570796, are parallel to a millionth.
    """
    data = model.createData()
    columns = [model.joints[j].idx_v for j in model.supports[joint] if j]
    jacobian = pin.computeJointJacobians(model, data, np.zeros(model.nq)).reshape(
        6, model.nv
    )  # one joint's is flat
    turning = jacobian[3:, columns].T @ data.oMi[joint].rotation
    ways = [way for way in turning if np.linalg.norm(way) > 0.5]
    other = [way for way in ways[1:] if np.linalg.norm(np.cross(way, ways[0])) > 1e-6]
    return ways[:1] + other[:1]


def to_urdf(rig: Rig, phi: Array) -> str:
    """Return the rig's URDF, payload included, with inertials that lump to `phi`; every other tag is kept.

    Links fixed to each other are one body, of which only the sum shows. The payload's link takes the change if that
    leaves it physical, else the moving link does, else all links of the body share the sum in proportion to mass.

    `phi`: physical, (10 n,).
    """
    inertials: dict[str, urdf.LinkInertia] = {}
    for body, parameters in enumerate(np.reshape(phi, (-1, 10)), start=1):
        for link, part in _split_over_links(
            rig, body, pin.Inertia.FromDynamicParameters(parameters)
        ).items():
            inertials[link] = (part.mass, np.array(part.lever), np.array(part.inertia))
    return urdf.replace_inertials(rig.urdf, inertials)


def _split_over_links(rig: Rig, body: int, total: pin.Inertia) -> Mapping[str, pin.Inertia]:
    """Split a body's inertia over its links, each in its own link's frame."""
    frames = {
        f.name: f
        for f in rig.model.frames
        if f.parentJoint == body and f.type == pin.FrameType.BODY
    }
    given = {
        link: pin.Inertia(*own)
        for link, own in urdf.read_inertials(rig.urdf).items()
        if link in frames
    }
    massive = {
        link: frames[link].placement.act(own).toDynamicParameters() for link, own in given.items()
    }
    phi = total.toDynamicParameters()
    parts = {
        link: own[0] / sum(each[0] for each in massive.values()) * phi
        for link, own in massive.items()
    }
    for link in (rig.links[body - 1], rig.payload_link):
        rest = phi - sum((own for name, own in massive.items() if name != link), np.zeros(10))
        if link in massive and is_physical(rest):
            parts = {link: rest}
    if not massive:
        return {rig.links[body - 1]: total}
    return {
        x: frames[x].placement.actInv(pin.Inertia.FromDynamicParameters(part))
        for x, part in parts.items()
    }
