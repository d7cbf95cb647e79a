"""Physical consistency: the inertias that bodies can have.

A body is physical if its pseudo-inertia ``[[Σ, h], [hᵀ, m]]`` is positive definite (Wensing, Kim and Slotine 2018):
positive mass, and principal inertias that satisfy the triangle inequality strictly. Log-Cholesky parameters reach
these bodies and no others (Rucker and Wensing 2022).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from gimbal_pin.errors import ModelError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.arrays import Array
from gimbal_pin.rig.rig import Rig


def pseudo_inertia(phi: Array) -> Array:
    """``[[Σ, h], [hᵀ, m]]`` of one body's ten parameters, (4, 4)."""
    return np.array(pin.PseudoInertia.FromDynamicParameters(np.asarray(phi)).toMatrix())


def physical(phi: Array) -> bool:
    """Whether every body of (10 n,) parameters is one that can exist."""
    return all(np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0 for body in np.reshape(phi, (-1, 10)))


def strictly(phi: Array) -> Array:
    """Return a body's parameters, thickened by a millionth if it is flat: log-Cholesky parameters reach no plate."""
    if physical(phi):
        return phi
    P = pseudo_inertia(phi)
    thick = P + 1e-6 * max(float(np.trace(P[:3, :3])), 1e-9) * np.diag([1.0, 1.0, 1.0, 0.0])
    out = np.array(pin.PseudoInertia.FromMatrix(thick).toDynamicParameters())
    if not physical(out):
        raise ModelError("inertial parameters", "of the URDF are not physical", "mend them: see 'gimbal-pin check'")
    return out


def to_urdf(rig: Rig, phi: Array) -> str:
    """Return the rig's URDF, payload included, with inertials that lump to `phi`; every other tag is kept.

    Links fixed to each other are one body, of which only the sum shows. The payload's link takes the change if that
    leaves it physical, else the moving link does, else all links of the body share the sum in proportion to mass.

    `phi`: physical, (10 n,).
    """
    inertials: dict[str, tuple[float, Array, Array]] = {}
    for body, parameters in enumerate(np.reshape(phi, (-1, 10)), start=1):
        for link, part in shared(rig, body, pin.Inertia.FromDynamicParameters(parameters)).items():
            inertials[link] = (part.mass, np.array(part.lever), np.array(part.inertia))
    return urdf.with_inertials(rig.urdf, inertials)


def shared(rig: Rig, body: int, total: pin.Inertia) -> Mapping[str, pin.Inertia]:
    """Split a body's inertia over its links, each in its own link's frame."""
    frames = {f.name: f for f in rig.model.frames if f.parentJoint == body and f.type == pin.FrameType.BODY}
    given = {link: pin.Inertia(*own) for link, own in urdf.inertials(rig.urdf).items() if link in frames}
    massive = {link: frames[link].placement.act(own) for link, own in given.items()}
    for link in (rig.payload_link, rig.links[body - 1]):
        if link in massive:
            others = sum((part.toDynamicParameters() for name, part in massive.items() if name != link), np.zeros(10))
            rest = total.toDynamicParameters() - others
            if physical(rest):
                own = pin.Inertia.FromDynamicParameters(rest)
                return {link: frames[link].placement.actInv(own)}
    if not massive:
        return {rig.links[body - 1]: total}
    weight = {link: part.mass / sum(p.mass for p in massive.values()) for link, part in massive.items()}
    return {
        link: frames[link].placement.actInv(pin.Inertia.FromDynamicParameters(share * total.toDynamicParameters()))
        for link, share in weight.items()
    }
