"""Fits that are a multiple of the URDF's are named with the unit that makes them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import identify
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.rigs import bundled


@pytest.fixture(scope="module")
def rig() -> Rig:
    """A turret with known torque constants."""
    plain = bundled("turret")
    return replace(
        plain, motors=tuple(replace(motor, torque_constant=0.4) for motor in plain.motors)
    )


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return prescribed(nominal(rig), seconds=16.0, dt=4e-3, torque_noise=5e-3)


def scaled(log: Log, joint: int, **factors: float) -> Log:
    """Multiply some channels of one joint."""
    changes = {name: np.array(getattr(log, name)) for name in factors}
    for name, factor in factors.items():
        changes[name][:, joint] *= factor
    return replace(log, **changes)


def reverse_gravity(rig: Rig) -> Log:
    """Simulate a rig that hangs upside down."""
    model = rig.model.copy()
    model.gravity.linear = -model.gravity.linear
    return prescribed(nominal(replace(rig, model=model)), seconds=16.0, dt=4e-3, torque_noise=5e-3)


def said(rig: Rig, log: Log) -> str:
    """What is said of factors, in one text."""
    return " | ".join(
        text for text in identify(rig, [log], filtering=EXACT).faults if "times the URDF's" in text
    )


@pytest.mark.parametrize(
    ("joint", "factor", "name"),
    [
        ("pan", 2.5, "1/torque_constant"),
        ("tilt", 2.5, "1/torque_constant"),
        ("tilt", 0.4, "torque_constant"),
        ("pan", 6.0, ""),
    ],
)
def test_a_torque_in_another_unit_is_named_with_its_factor(
    rig: Rig, log: Log, joint: str, factor: float, name: str
) -> None:
    text = said(rig, scaled(log, rig.joints.index(joint), tau=factor))
    (ratio,) = re.findall(rf"{joint}: inertia ([\d.]+) ± [\d.]+ times", text)
    assert float(ratio) == pytest.approx(factor, rel=0.1)
    assert f"({name} is" in text or not name
    (mended,) = re.findall(rf"--map 'tau_{joint}=tau_{joint}\*([\d.]+)'", text)
    assert float(mended) == pytest.approx(1 / factor, rel=0.05) and text.count("inertia") == 1


@pytest.mark.parametrize("constants", [(0.21, 0.17), (0.1, 0.5), (2.5, 2.5)])
def test_currents_are_named_with_each_motors_torque_constant(
    constants: tuple[float, float], log: Log
) -> None:
    plain = bundled("turret")
    motors = tuple(replace(motor, torque_constant=k) for motor, k in zip(plain.motors, constants))
    text = said(replace(plain, motors=motors), replace(log, tau=log.tau / np.array(constants)))
    for joint, constant in zip(plain.joints, constants):
        assert f"--map 'tau_{joint}=tau_{joint}*{constant}'" in text


def test_an_angle_in_another_unit_is_named(rig: Rig, log: Log) -> None:
    """Dry friction is right then, and inertia is not; where gravity pulls, another angle is no multiple."""
    text = said(rig, scaled(log, 0, q=1 / 3, v=1 / 3))
    assert "q_pan=q_pan*3" in text and "tau_" not in text and "torque_constant" not in text


@pytest.mark.parametrize("speed", [2.0, 0.4])
def test_one_factor_of_all_inertias_is_named_as_time(rig: Rig, log: Log, speed: float) -> None:
    text = said(rig, replace(log, t=log.t / speed, v=None))
    (factor,) = re.findall(r"--map t=t\*([\d.]+)", text)
    assert float(factor) == pytest.approx(speed, rel=0.1)


@pytest.mark.parametrize("name", ["turret", "handheld"])
def test_gravity_that_pulls_the_other_way_is_named(name: str) -> None:
    rig = bundled(name)
    assert re.search(
        r"gravity's torque -1 ± .*horizontal axis if the rig hangs", said(rig, reverse_gravity(rig))
    )


@pytest.mark.parametrize("name", ["turret", "thesis", "ptu"])
def test_nothing_is_said_of_what_the_urdf_states(name: str) -> None:
    rig = bundled(name)
    heavier = rig.with_phi(1.3 * rig.phi)
    for given in (rig, heavier):
        assert not said(rig, prescribed(nominal(given), seconds=16.0, dt=4e-3, torque_noise=0.01))


FEW = {name: CAUSES[name] for name in ("cogging", "torque-gain")}


@pytest.mark.parametrize(
    ("constants", "verdict"),
    [((1.0, 1.0), "nothing"), ((0.4, 1.0), "unknown"), ((0.15, 0.2), "unknown")],
)
def test_a_diagnosis_calls_another_unit_by_its_name_and_no_gain(
    rig: Rig, log: Log, constants: tuple[float, float], verdict: str
) -> None:
    found = diagnose(rig, [replace(log, tau=log.tau / np.array(constants))], FEW, filtering=EXACT)
    assert found.verdict == verdict
    assert bool(found.statements) == (verdict == "unknown")
    assert not found.findings
