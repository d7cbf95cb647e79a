"""A model as MJCF: its bodies, friction, rotors, springs and drives, as far as MuJoCo has them."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import (
    ActuatorLag,
    Armature,
    CableSpring,
    Rotor,
    Saturation,
    Term,
    TorqueGain,
)
from gimbal_pin.effects.resistance import Resistance
from gimbal_pin.errors import ModelError
from gimbal_pin.rig.inertia import describe_broken_rule
from gimbal_pin.rig.meshes import find_mesh_file
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.urdf import format_numbers, parse_robot, read_numbers, read_pose


def convert_to_mjcf(model: Model) -> tuple[str, tuple[str, ...]]:
    """Return MJCF whose ``M(q) a + c(q, v) + g(q)`` and passive torques are the model's, and what it does not hold.

    Coulomb and viscous friction are ``frictionloss`` and ``damping``, a rotor ``armature``, a linear spring
    ``stiffness`` about ``springref``. An actuator takes the torque on the motor's side, N m: ``ctrl`` times ``gear`` is
    the joint's. A torque gain is its ``gainprm``, a lag its filter, the largest torque its ``forcerange``.

    Returns:
        The XML, with the notes as a comment; and a note on each thing that MuJoCo has no element for.

    Raises:
        ModelError: A body's inertia is none that exists.
    """
    rig = model.rig
    notes = list(_iterate_unwritten(model))
    root = etree.Element("mujoco", model=rig.name)
    etree.SubElement(root, "compiler", angle="radian", autolimits="true")
    etree.SubElement(root, "option", gravity=format_numbers(rig.model.gravity.linear))
    asset = etree.SubElement(root, "asset")
    bodies = [etree.SubElement(root, "worldbody")]
    for j in range(1, rig.n + 1):
        bodies.append(_write_body(bodies[rig.model.parents[j]], model, j))
    notes += _add_shapes(rig, bodies, asset)
    actuators, sensors = (etree.SubElement(root, tag) for tag in ("actuator", "sensor"))
    for j, joint in enumerate(rig.joints):
        _add_actuator(actuators, model, j)
        for kind in ("jointpos", "jointvel", "jointactuatorfrc"):
            etree.SubElement(sensors, kind, name=f"{joint}_{kind}", joint=joint)
    for link in rig.config.imus:
        for kind in ("gyro", "accelerometer"):
            etree.SubElement(sensors, kind, name=f"{link}_{kind}", site=link)
    for note in notes:
        root.insert(0, etree.Comment(f" {re.sub('-(?=-)', '- ', note)} "))
    etree.indent(root)
    return etree.tostring(root, encoding="unicode") + "\n", tuple(notes)


def _iterate_unwritten(model: Model) -> Iterator[str]:
    """Yield a note on each term, drive and change of a model that MuJoCo has no element for."""
    lost = [
        term.sentence() for term in model.terms if not (term.effect.affine or _is_written(term))
    ]
    lags = {
        signal.joint: signal for signal in reversed(model.drive) if isinstance(signal, ActuatorLag)
    }
    sharp = [
        signal
        for signal in model.drive
        if isinstance(signal, Saturation) and not (signal.knee or signal.side)
    ]
    lost += [signal.sentence() for signal in model.drive if signal not in (*lags.values(), *sharp)]
    lost += [
        change.sentence()
        for change in model.changes
        if change.carried(np.zeros(1), None) is not None
    ]
    yield from (f"not in MuJoCo's model: {sentence}" for sentence in lost)
    resistance = Resistance(model.by_joint)
    for joint, constant in zip(model.rig.joints, resistance.constant):
        if constant:
            size = f"{constant:+.6g} {model.rig.in_units(joint, 'N m')}"
            yield f"not in MuJoCo's model: {joint}: a constant torque of {size}; subtract it in qfrc_applied"
    for kind, values in (("frictionloss", resistance.per_slide), ("damping", resistance.per_rate)):
        yield from (
            f"{joint}: {kind} {x:.3g} is written as 0"
            for joint, x in zip(model.rig.joints, values)
            if x < 0
        )


def _is_written(term: Term) -> bool:
    """Whether MuJoCo has an element for a term that is not affine in direction and rate."""
    effect = term.effect
    linear_spring = isinstance(effect, CableSpring) and not (
        effect.stiffening or effect.growth or effect.taut
    )
    gain = isinstance(effect, TorqueGain) and effect.side == 0
    return isinstance(effect, (Armature, Rotor)) or gain or (linear_spring and term.values[1] > 0)


def _write_body(parent: etree._Element, model: Model, j: int) -> etree._Element:
    """Add the body of the j-th joint, from 1: place, inertia, joint, and what acts passively there."""
    rig = model.rig
    at = model.rig.model.jointPlacements[j]
    inertia = model.rig.model.inertias[j]
    about = np.asarray(inertia.inertia)
    rule = "has no mass" if not inertia.mass > 0 else describe_broken_rule(about)
    if rule is not None:
        raise ModelError(
            f"body {rig.links[j - 1]}", rule, "identify it again with --estimator physical"
        )
    body = etree.SubElement(parent, "body", name=rig.links[j - 1], **_format_pose(at))
    entries = [
        about[row, column] for row, column in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    ]
    full = {"mass": f"{inertia.mass:.17g}", "fullinertia": format_numbers(entries)}
    etree.SubElement(body, "inertial", pos=format_numbers(inertia.lever), **full)
    data = rig.model.joints[j].createData()
    limits = rig.limits[j - 1]
    joint = rig.joints[j - 1]
    rig.model.joints[j].calc(data, np.zeros(1))
    way = np.asarray(data.S).ravel()
    sliding = rig.slides[j - 1]
    resistance = Resistance(model.by_joint[j - 1 : j])
    rotor = float((rig.armature + model.armature)[j - 1])
    written = {
        "type": "slide" if sliding else "hinge",
        "axis": format_numbers(way[:3] if sliding else way[3:]),
        "armature": f"{rotor:.17g}",
        "frictionloss": f"{max(resistance.per_slide[0], 0.0):.17g}",
        "damping": f"{max(resistance.per_rate[0], 0.0):.17g}",
    }
    if np.isfinite([limits.lower, limits.upper]).all():
        written["range"] = format_numbers([limits.lower, limits.upper])
    springs = [
        t.values
        for t in model.by_joint[j - 1]
        if isinstance(t.effect, CableSpring) and _is_written(t)
    ]
    if springs:
        offset, stiffness = np.sum(springs, axis=0)
        written |= {"stiffness": f"{stiffness:.17g}", "springref": f"{-offset / stiffness:.17g}"}
    etree.SubElement(body, "joint", name=joint, **written)
    return body


def _add_actuator(actuators: etree._Element, model: Model, j: int) -> None:
    """Add the motor of the j-th joint, from 0."""
    rig = model.rig
    gear = model.rig.motors[j].gear_ratio
    gains = [
        1 - t.values[0]
        for t in model.by_joint[j]
        if isinstance(t.effect, TorqueGain) and _is_written(t)
    ]
    written = {"gear": f"{gear:.17g}", "gainprm": f"{np.prod(gains):.17g}"}
    if np.isfinite(most := float(np.prod(gains)) * model.tau_max[j] / abs(gear)):
        written["forcerange"] = format_numbers([-most, most])
    lags = [signal.time_constant for signal in model.drives[j] if isinstance(signal, ActuatorLag)]
    if lags:
        written |= {"dyntype": "filterexact", "dynprm": f"{lags[0]:.17g}"}
    etree.SubElement(actuators, "general", name=rig.joints[j], joint=rig.joints[j], **written)


def _add_shapes(rig: Rig, bodies: list[etree._Element], asset: etree._Element) -> list[str]:
    """Add to each body what is seen of its links, which touches nothing, camera and IMUs; return notes on the rest."""
    robot = parse_robot(rig.urdf, str(rig.path))
    notes = list[str]()
    sizes = {"box": "size", "sphere": "radius", "cylinder": "radius length"}
    for frame in (one for one in rig.model.frames if one.type == pin.FrameType.BODY):
        body = bodies[frame.parentJoint]
        look = {"contype": "0", "conaffinity": "0", "group": "2"}
        if frame.name in {rig.camera_frame, *rig.config.imus}:
            etree.SubElement(body, "site", name=frame.name, **_format_pose(frame.placement))
        if frame.name == rig.camera_frame:  # MuJoCo's looks along -z, its y is up
            turned = frame.placement.rotation @ np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
            place = {
                "pos": format_numbers(frame.placement.translation),
                "xyaxes": format_numbers(turned.T.ravel()),
            }
            etree.SubElement(body, "camera", name=frame.name, **place)
        for visual in robot.xpath("link[@name=$name]/visual", name=frame.name):
            shape = visual.find("geometry")[0]
            place = _format_pose(frame.placement * read_pose(visual))
            if shape.tag in sizes:
                numbers = np.concatenate(
                    [read_numbers(shape, key, "0") for key in sizes[shape.tag].split()]
                )
                numbers *= [0.5] * 3 if shape.tag == "box" else [1.0, 0.5][: len(numbers)]
                etree.SubElement(
                    body, "geom", type=shape.tag, size=format_numbers(numbers), **look, **place
                )
                continue
            file = find_mesh_file(shape.get("filename", ""), rig.path.parent)
            if shape.tag == "mesh" and file is not None and file.suffix.lower() in (".stl", ".obj"):
                name = f"mesh{len(asset)}"
                scale = shape.get("scale", "1 1 1")
                etree.SubElement(asset, "mesh", name=name, file=str(file), scale=scale)
                etree.SubElement(body, "geom", type="mesh", mesh=name, **look, **place)
            else:
                notes.append(
                    f"not drawn: {shape.get('filename', shape.tag)} of {frame.name}; MuJoCo reads STL and OBJ"
                )
    return notes


def _format_pose(at: pin.SE3) -> dict[str, str]:
    """Return ``pos`` and ``quat`` (w, x, y, z) of a pose."""
    x, y, z, w = pin.Quaternion(at.rotation).coeffs()
    return {"pos": format_numbers(at.translation), "quat": format_numbers([w, x, y, z])}
