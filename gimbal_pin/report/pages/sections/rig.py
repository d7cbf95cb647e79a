"""What the rig is: motors, limits, bodies, payload."""

from __future__ import annotations

from math import isfinite

from markupsafe import Markup

from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Content, join, paragraph, table
from gimbal_pin.report.pages.joints import Joint, joints_of
from gimbal_pin.report.pages.numbers import DASH, figures, listed
from gimbal_pin.rig import urdf
from gimbal_pin.rig.config import Limits, Motor
from gimbal_pin.rig.rig import Rig


def rig_section(rig: Rig) -> Section:
    """Return a rig's joints, motors, limits and moved masses as its URDF and YAML state them."""
    looks = list(enumerate(joints_of(rig)))
    limits = ["Joint", "Moves", "Travel", "Rate", "Acceleration", "Torque limit, N m", "Torque constant, N m/A"]
    motors = ["Joint", "Encoder", "Step", "Slots", "Poles", "Coulomb, N m", "Viscous, N m s/rad", "Carries, kg"]
    parts = [
        paragraph(about(rig)),
        table(limits, [limits_row(rig, j, joint) for j, joint in looks], texts=2, caption="Joints and limits"),
        table(motors, [motor_row(rig, j, joint) for j, joint in looks], caption="Motors, sensors and loads, as given"),
    ]
    return Section("Rig", join(parts), rig.config.description)


def limits_row(rig: Rig, j: int, joint: Joint) -> list[Content]:
    """Return a joint's row of limits."""
    limit = rig.limits[j]
    return [
        joint.label,
        rig.links[j],
        travel(limit, joint),
        joint.text(limit.velocity, "/s"),
        joint.text(limit.acceleration, "/s²"),
        figures(float(rig.tau_max[j])) if isfinite(rig.tau_max[j]) else DASH,
        figures(rig.motors[j].torque_constant),
    ]


def travel(limit: Limits, joint: Joint) -> str:
    """Return a joint's travel as text."""
    if not (isfinite(limit.lower) or isfinite(limit.upper)):
        return "unlimited"
    return f"{joint.text(limit.lower)} … {joint.text(limit.upper)}"


def motor_row(rig: Rig, j: int, joint: Joint) -> list[Content]:
    """Return a joint's row of motor, sensor and load."""
    motor, (dry, viscous) = rig.motors[j], rig.friction[j].tolist()
    carried = sum(rig.model.inertias[k].mass for k in range(1, rig.n + 1) if j + 1 in list(rig.model.supports[k]))
    return [
        joint.label,
        f"{motor.encoder_bits:g} bit" if motor.encoder_bits else DASH,
        step(motor, joint),
        str(motor.slots) if motor.slots else DASH,
        str(motor.poles) if motor.poles else DASH,
        figures(dry),
        figures(viscous),
        figures(carried),
    ]


def step(motor: Motor, joint: Joint) -> str:
    """Return the size of an encoder's step."""
    return joint.text(motor.encoder_step, digits=2) if motor.encoder_bits else DASH


def about(rig: Rig) -> Markup:
    """Return what is mounted and what the frames are called."""
    parts = [Markup("Moved mass {} kg.").format(figures(sum(body.mass for body in rig.model.inertias[1:])))]
    if rig.payload:
        mass = payload_mass(rig)
        weight = f" ({figures(mass)} kg)" if mass else ""
        parts.append(Markup("Payload <b>{}</b>{}.").format(rig.payload, weight))
    frames = Markup("Base link <code>{}</code>; line of sight along x of <code>{}</code>.")
    parts.append(frames.format(rig.base, rig.camera_frame))
    if rig.config.imus:
        parts.append(Markup("IMUs on {}.").format(listed(rig.config.imus)))
    return Markup(" ").join(parts)


def payload_mass(rig: Rig) -> float:
    """Return the mass of the mounted payload's links, kg; 0 where none is mounted."""
    robot = urdf.parse(rig.urdf, rig.name)
    parent = {j.find("child").get("link"): j.find("parent").get("link") for j in robot.findall("joint")}

    def mounted(link: str | None) -> bool:
        return link is not None and (link == rig.payload_link or mounted(parent.get(link)))

    masses = {link.get("name"): link.find("inertial/mass") for link in robot.findall("link")}
    return sum(float(mass.get("value")) for link, mass in masses.items() if mass is not None and mounted(link))
