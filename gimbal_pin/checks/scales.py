"""Units and mounts that a fit contradicts: inertia, gravity and dry friction in multiples of the URDF's."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, log, sqrt
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks.channel_assignment import POOR, compute_torque_size
from gimbal_pin.dynamics.configurations import spread_reference_states
from gimbal_pin.dynamics.regressor import compute_inertia_regressor, compute_regressor
from gimbal_pin.errors import digits, format_estimate
from gimbal_pin.log.log import Array
from gimbal_pin.regression import TRUST, Design, DesignBlocks, Estimate
from gimbal_pin.regression.covariance import NORMAL_975
from gimbal_pin.regression.design import find_base_columns

LEAST_FACTOR = exp(NORMAL_975 * TRUST)
"""Factor, 1.8, that bodies known to 30 % (`TRUST`) exceed in one of 20 cases: smaller ones are the rig's own business.
Doubling the deviation makes it 3.2, and hides a torque constant of 0.5."""


class Ratio(NamedTuple):
    """A fitted quantity in multiples of the URDF's, and its standard deviation."""

    value: float
    std: float

    def __str__(self) -> str:
        """Value ± 95 %."""
        return f"{format_estimate(self.value, self.std, 2)} times"

    @property
    def is_certain(self) -> bool:
        """Whether it is known better than the URDF's bodies are, within `TRUST`."""
        return NORMAL_975 * self.std < TRUST * abs(self.value)

    def is_near(self, factor: float) -> bool:
        """Return whether it may be this factor but for what a URDF is known to."""
        slack = NORMAL_975 * self.std / abs(self.value) + log(LEAST_FACTOR)
        return self.value / factor > 0 and abs(log(self.value / factor)) < slack


class ScaleFault(NamedTuple):
    """A multiple of the URDF's that a unit or a mount would make.

    Attributes:
        sentence: The ratios, and what would make them.
        torques: Joints whose torque seems to be in another unit: a gain of it is this factor.
    """

    sentence: str
    torques: tuple[str, ...] = ()


def compare_scales(blocks: DesignBlocks, estimate: Estimate) -> tuple[ScaleFault, ...]:
    """Return statements on joints whose fit is a multiple of the URDF's, on one for all of them, and on gravity's sign.

    Each states ratios with 95 % intervals, which are facts of the fit, and then the unit that would make them. Nothing
    is said of a fit that leaves a tenth of a joint's torque, or of ratios known no better than the URDF. By the URDF's
    own deviation, one joint in 20 whose bodies are known to 30 % is mentioned.

    Args:
        blocks: The rows that were fitted.
        estimate: Their weighted or any other least squares.
    """
    design = blocks.design
    size = compute_torque_size(blocks)
    rig = design.rig
    stated = np.concatenate([design.mixing @ design.rig.phi, design.rig.friction.ravel()])
    fitted = estimate.theta[: len(stated)]
    covariance = estimate.covariance[: len(stated), : len(stated)]
    if np.any(estimate.residual_std > POOR * size) or not np.isfinite(covariance).all():
        return ()

    def compare(row: Array) -> Ratio:
        """Return the ratio of a linear function of the base parameters and the friction, (k,)."""
        whole = np.append(row, np.zeros(len(stated) - len(row)))
        return Ratio(
            *(
                np.array([whole @ fitted, sqrt(whole @ covariance @ whole)]) / (whole @ stated)
            ).tolist()
        )

    places = find_base_columns(rig, design.reduction)
    q = spread_reference_states(rig).q
    columns = compute_regressor(rig, q, np.zeros_like(q), np.zeros_like(q), places=places)
    pull = columns @ stated[: len(places)]
    parts = list[dict[str, Ratio]]()
    for j in range(rig.n):
        own = {"inertia": compare(compute_inertia_regressor(rig, q, j, places)[:, j].mean(axis=0))}
        if np.sqrt(np.mean(pull[:, j] ** 2)) > POOR * size[j]:
            own["gravity's torque"] = compare(pull[:, j] @ columns[:, j])
        if rig.friction[j, 0] > 0:
            own["dry friction"] = compare(np.eye(len(stated))[len(places) + 2 * j])
        parts.append(
            {name: ratio for name, ratio in own.items() if ratio.is_certain or name == "inertia"}
        )
    inertias = [own["inertia"] for own in parts]
    off = [
        j
        for j, ratio in enumerate(inertias)
        if ratio.value > 0 and ratio.is_certain and not ratio.is_near(1.0)
    ]
    why = (
        "turn the origin of the URDF's first joint by pi about a horizontal axis if the rig hangs upside down; else the"
        " centre of mass lies on the other side of the joint's axis"
    )
    said = [
        ScaleFault(f"{_list_ratios(rig.joints[j], own)}: {why}")
        for j, own in enumerate(parts)
        if "gravity's torque" in own and own["gravity's torque"].is_near(-1.0)
    ]
    listed = "; ".join(map(_list_ratios, rig.joints, parts))
    constants = [motor.torque_constant or 1.0 for motor in rig.motors]
    if all(map(_is_current, constants, parts)) and len(off) == rig.n > 1 and design.logs:
        names = [f"tau_{joint}" for joint in rig.joints]
        maps = design.logs[0].remapped({name: (name, k) for name, k in zip(names, constants)})
        sentence = f"{listed}: each is 1/torque_constant of its motor, as if the torques were currents: {maps}"
        return (*said, ScaleFault(sentence, rig.joints))
    common = exp(sum(log(inertias[j].value) for j in off) / max(len(off), 1))
    if len(off) < max(rig.n, 2) or not all(ratio.is_near(common) for ratio in inertias):
        each = [(rig.joints[j], parts[j], _name_unit(design, j, parts[j])) for j in off]
        alike = [(joint,) if _is_of_torque(own) else () for joint, own, _ in each]
        return (
            *said,
            *(
                ScaleFault(f"{_list_ratios(joint, own)}{unit}", at)
                for (joint, own, unit), at in zip(each, alike)
            ),
        )
    is_time = all(own.get("gravity's torque", Ratio(1.0, 0.0)).is_near(1.0) for own in parts)
    is_torque = all(own.get("gravity's torque", own["inertia"]).is_near(common) for own in parts)
    unit = ""
    if is_time:
        unit = f", as if time, --map t=t*{digits(common**-0.5, 2)}, had another unit"
    elif is_torque:
        unit = ", as if every torque had another unit"
    sentence = f"{listed}: one factor, {digits(common, 2)}, fits all inertias{unit}"
    return (*said, ScaleFault(sentence, rig.joints if is_torque and not is_time else ()))


def _is_of_torque(parts: Mapping[str, Ratio]) -> bool:
    """Return whether everything known of a joint's torque has the factor of its inertia."""
    return len(parts) > 1 and all(ratio.is_near(parts["inertia"].value) for ratio in parts.values())


def _list_ratios(joint: str, parts: Mapping[str, Ratio]) -> str:
    """Return what a joint's parts are in multiples of the URDF's."""
    return f"{joint}: {', '.join(f'{name} {ratio}' for name, ratio in parts.items())} the URDF's"


def _is_current(constant: float, parts: Mapping[str, Ratio]) -> bool:
    """Return whether a joint's parts are those of a torque over its motor's torque constant, N m per A."""
    factor = parts["inertia"].value
    is_constant = abs(log(constant)) > TRUST and factor > 0 and abs(log(factor * constant)) < TRUST
    return is_constant and all(ratio.is_near(factor) for ratio in parts.values())


def _name_unit(design: Design, j: int, parts: Mapping[str, Ratio]) -> str:
    """Return what would make the factor of one joint's inertia: the torque's unit if its other parts have it, too.

    The angle's if dry friction alone is beside it, and right: gravity's torque is no multiple in another angle.
    """
    joint = design.rig.joints[j]
    motor = design.rig.motors[j]
    factor = parts["inertia"].value
    others = [ratio for part, ratio in parts.items() if part != "inertia"]
    is_torque = all(ratio.is_near(factor) for ratio in others)
    is_angle = (
        not is_torque and "gravity's torque" not in parts and parts["dry friction"].is_near(1.0)
    )
    known = {
        "gear_ratio": abs(motor.gear_ratio),
        "torque_constant": (is_torque and motor.torque_constant) or 1.0,
    }
    known |= {f"1/{name}": 1 / k for name, k in known.items()}
    near = [
        name for name, k in known.items() if abs(log(k)) > TRUST and abs(log(factor / k)) < TRUST
    ]
    k = known[near[0]] if near else float(f"{factor:.2g}")
    column, change = (f"tau_{joint}", 1 / k) if is_torque else (f"q_{joint}", k)
    mapped = f": {design.logs[0].remapped({column: (column, change)})}" if design.logs else ""
    unit = (
        f", as if {column} had another unit{mapped}" if others and (is_torque or is_angle) else ""
    )
    return f" ({near[0]} is {digits(k, 3)}){unit}" if near else unit
