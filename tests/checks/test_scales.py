"""Fits that are a multiple of the URDF's are named with the unit that makes them."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import identify
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.rigs import bundled


def with_constants(*constants: float) -> Rig:
    """Return the turret with these torque constants."""
    rig = bundled("turret")
    motors = (replace(motor, torque_constant=k) for motor, k in zip(rig.motors, constants))
    return replace(rig, motors=tuple(motors))


RIG = with_constants(0.4, 0.4)


@cache
def recorded(rig: Rig = RIG) -> Log:
    """Return the log of a rig."""
    return prescribed(nominal(rig), seconds=16.0, dt=4e-3, torque_noise=5e-3)


def said(rig: Rig, log: Log) -> str:
    """What is said of factors, in one text."""
    return " | ".join(
        text for text in identify(rig, [log], filtering=EXACT).faults if "times the URDF's" in text
    )


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        (
            {"tau": [2.5, 1.0]},
            r"^pan: inertia 2\.[3-7]\S* ± [^|]* \(1/torque_constant is .*--map 'tau_pan=tau_pan\*0\.4'$",
        ),
        (
            {"tau": [1.0, 0.4]},
            r"^tilt: inertia 0\.[34]\S* ± [^|]* \(torque_constant is .*--map 'tau_tilt=tau_tilt\*2\.5'$",
        ),
        (
            {"tau": [6.0, 1.0]},
            r"^pan: inertia [56]\S* ± [^|]*--map 'tau_pan=tau_pan\*0\.1[67]\d*'$",
        ),
        ({"q": [1 / 3, 1.0], "v": [1 / 3, 1.0]}, r"^pan[^|]*--map 'q_pan=q_pan\*3(\.\d)?'$"),
        ({"tau": [6.0, 6.0]}, r"6\S* fits all inertias, as if every torque had another unit"),
        ({"t": 0.5}, r"--map t=t\*(2|1\.9|2\.1),"),
        ({"t": 2.5}, r"--map t=t\*0\.(4|39|41),"),
    ],
)
def test_another_unit_is_named_with_its_factor(
    changes: dict[str, float | list[float]], pattern: str
) -> None:
    """A torque's, an angle's where dry friction is right and inertia is not, and time's by all inertias at once."""
    log = recorded()
    changed = {name: getattr(log, name) * factor for name, factor in changes.items()}
    if "t" in changes:
        changed["v"] = None
    text = said(RIG, replace(log, **changed))
    assert re.search(pattern, text), text


@pytest.mark.parametrize("constants", [(0.21, 0.17), (2.5, 2.5)])
def test_currents_are_named_with_each_motors_torque_constant(
    constants: tuple[float, float],
) -> None:
    log = recorded()
    text = said(with_constants(*constants), replace(log, tau=log.tau / np.array(constants)))
    for joint, constant in zip(RIG.joints, constants):
        assert f"--map 'tau_{joint}=tau_{joint}*{constant}'" in text


@pytest.mark.parametrize("name", ["turret", "handheld"])
def test_gravity_that_pulls_the_other_way_is_named(name: str) -> None:
    rig = bundled(name)
    model = rig.model.copy()
    model.gravity.linear = -model.gravity.linear
    text = said(rig, recorded(replace(rig, model=model)))
    ratio = re.search(r"gravity's torque (\S+) ± .*horizontal axis if the rig hangs", text)
    assert ratio is not None and float(ratio[1]) == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("name", ["turret", "thesis"])
@pytest.mark.parametrize("heavier", [1.0, 1.3])
def test_nothing_is_said_of_what_the_urdf_states(name: str, heavier: float) -> None:
    rig = bundled(name)
    assert not said(rig, recorded(rig.with_phi(heavier * rig.phi)))


@pytest.mark.parametrize(
    ("constants", "verdict"), [((1.0, 1.0), "nothing"), ((0.4, 1.0), "unknown")]
)
def test_a_diagnosis_calls_another_unit_by_its_name_and_no_gain(
    constants: tuple[float, float], verdict: str
) -> None:
    log = recorded()
    amperes = replace(log, tau=log.tau / np.array(constants))
    found = diagnose(RIG, [amperes], filtering=EXACT)
    assert found.verdict == verdict
    assert bool(found.statements) == (verdict == "unknown")
    assert not found.findings
