"""The band of a diagnosis holds the lines of a turning joint's torque, and follows no noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import DIAGNOSIS_BAND, choose_band, diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.errors import DataError
from gimbal_pin.log import Log, write_log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.command_line import Run, refused
from tests.rigs import bundled

ROTOR = """<robot name="rotor"><link name="base"/><link name="disc"><inertial><mass value="0.2"/>
<inertia ixx="1e-4" iyy="1e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="motor" type="continuous"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.fixture
def rotor(tmp_path: Path) -> Rig:
    path = tmp_path / "rotor.urdf"
    path.write_text(ROTOR, encoding="utf-8")
    return Rig.load(str(path))


def turning(amplitude: float, noise: float, turns: float = 0.8, teeth: int = 72) -> Log:
    """A loop holds a rate that wavers; its torque is friction, inertia and teeth, with white noise."""
    rng = np.random.default_rng(0)
    t = 1e-3 * np.arange(10000)
    rate = 2 * np.pi * turns
    waver = 2 * np.pi * 1.3
    q = rate * t + 0.05 * np.sin(waver * t)
    v = rate + 0.05 * waver * np.cos(waver * t)
    a = -0.05 * waver**2 * np.sin(waver * t)
    tau = (
        2e-4 * a
        + 4e-3
        + 1e-3 * v
        + amplitude * np.cos(teeth * q)
        + noise * rng.standard_normal(len(t))
    )
    return Log("turning", ("motor",), t, q[:, None], v[:, None], tau[:, None])


@pytest.mark.parametrize(("turns", "teeth"), [(0.3, 84), (0.8, 72), (1.0, 18)])
def test_the_band_holds_the_lines_of_the_teeth(rotor: Rig, turns: float, teeth: int) -> None:
    assert choose_band(rotor, [turning(5e-3, 1e-4, turns, teeth)]).cutoff >= turns * teeth


@pytest.mark.parametrize("noise", [1e-5, 1e-3, 1e-1])
def test_the_band_follows_no_noise(rotor: Rig, noise: float) -> None:
    assert choose_band(rotor, [turning(0.0, noise)]) == DIAGNOSIS_BAND


def test_teeth_that_pass_quickly_are_named(rotor: Rig) -> None:
    some = {name: CAUSES[name] for name in ("cogging", "stribeck")}
    found = diagnose(rotor, [turning(5e-3, 1e-3)], some, rng=np.random.default_rng(0))
    assert [(one.cause, one.status) for one in found.findings] == [("cogging", "named")]
    figures = {p.name: p.value for p in found.findings[0].parameters}
    assert figures["harmonic"] == 72 and figures["amplitude"] == pytest.approx(5e-3, rel=0.05)


RATES = [("turret", 30), ("thesis", 50), ("drone", 100)]


def slow(name: str, rate: int, seconds: float = 20.0) -> Log:
    """A log of a bundled rig at so many samples a second."""
    return prescribed(nominal(bundled(name)), 3, seconds, torque_noise=0.01, dt=1.0 / rate)


@pytest.mark.parametrize(("name", "rate"), RATES)
def test_a_log_of_a_low_rate_is_diagnosed_in_a_band_that_it_has(name: str, rate: int) -> None:
    log = slow(name, rate)
    some = {one: CAUSES[one] for one in ("stribeck", "torque-bias")}
    found = diagnose(bundled(name), [log], some, rng=0)
    assert not found.spoiling and not found.findings
    assert found.held is not None and found.held.band == pytest.approx(
        min(DIAGNOSIS_BAND.cutoff, rate / 10)
    )


@pytest.mark.parametrize(("name", "rate"), RATES[:2])
def test_verbs_take_a_log_of_a_low_rate_and_refuse_a_cutoff_that_it_cannot_carry(
    run: Run, name: str, rate: int, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    write_log(slow(name, rate, 12.0), path)
    assert run("tune", name, path, "-o", tmp_path / "controller.yaml")[0] == 0
    for verb in ("identify", "diagnose"):
        refused(
            run(verb, name, path, "--cutoff", 0.25 * rate), 2, "cutoff", f"at most {rate / 5:g} Hz"
        )


def test_ten_samples_a_second_are_refused_with_a_reason() -> None:
    """Hardly a sample of such a log lies away from standstill, by the filters' memory."""
    with pytest.raises(DataError):
        diagnose(bundled("turret"), [slow("turret", 10)], {"stribeck": CAUSES["stribeck"]}, rng=0)
