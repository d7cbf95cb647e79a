"""Laws of a camera whose mass the log does not show: its place is true for the mass that was weighed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import PayloadMass, PayloadShift
from gimbal_pin.errors import DataError
from gimbal_pin.identification import Several, identify, identify_new, identify_several
from gimbal_pin.log import Array, Log, write_log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.command_line import Run, result

ALIGNED = Filtering(alignment=0.0)
SHIFT = np.array([0.002, -0.0015, 0.001])
MASS = 0.29
"""Place of the second camera's centre of mass beside its URDF's, m, and its mass, kg, of which the URDF states .26."""
TILT = 0.3
GIMBALS = {
    "concentric at a fixed tilt": (
        ("0 0 1", f"{np.cos(TILT):.8f} 0 {np.sin(TILT):.8f}", "0 1 0"),
        ("0 0 0.03", "-0.05 0 0.07", f"0.05 0.05 {0.05 * np.tan(TILT):.4f}"),
    ),
    "orthogonal, roll 0.1 mm off": (
        ("0 0 1", "1 0 0", "0 1 0"),
        ("0 0 0.03", "-0.05 0 0.07", "0.05 0.05 0.0001"),
    ),
    "two axes": (("0 0 1", "0 1 0"), ("0 0 0.03", "0 0.06 0.07")),
}
"""Axes and origins of gimbals whose axes meet, but for less than a log shows."""


def write_gimbal(folder: Path, name: str) -> Path:
    """Write a gimbal's YAML and URDF, and two cameras."""
    parts = ['<robot name="gimbal"><link name="base"/>']
    parent = "base"
    for k, (axis, origin) in enumerate(zip(*GIMBALS[name])):
        parts.append(
            f'<link name="arm{k}"><inertial><origin xyz="0.02 -0.02 0.01"/><mass value="{0.09 - 0.02 * k}"/>'
            '<inertia ixx="4e-5" iyy="3e-5" izz="5e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="arm{k}"/>'
            f'<origin xyz="{origin}"/><axis xyz="{axis}"/><limit lower="-1" upper="1" velocity="4" effort="0.5"/>'
            '<dynamics friction="0.004" damping="0.0006"/></joint>'
        )
        parent = f"arm{k}"
    plate = '<link name="camera_mount"/><joint name="plate" type="fixed"><origin xyz="0 -0.06 0"/><parent link="{}"/>'
    parts.append(f'{plate.format(parent)}<child link="camera_mount"/></joint></robot>')
    (folder / "gimbal.urdf").write_text("".join(parts))
    for camera, mass, x, moment in (("first", 0.18, 0.002, 8e-5), ("second", 0.26, 0.01, 2e-4)):
        tensor = f'<inertia ixx="{1.1 * moment}" iyy="{0.8 * moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/>'
        (folder / f"{camera}.urdf").write_text(
            f'<robot name="{camera}"><link name="{camera}_body"><inertial><origin xyz="{x} 0 0.001"/>'
            f'<mass value="{mass}"/>{tensor}</inertial></link><link name="camera"/><joint name="optics" type="fixed">'
            f'<origin xyz="0.03 0 0"/><parent link="{camera}_body"/><child link="camera"/></joint></robot>'
        )
    path = folder / "rig.yaml"
    path.write_text(
        "urdf: gimbal.urdf\nmount: camera_mount\ncamera_frame: camera\noptical_axis: x\n"
    )
    return path


def change_second(rig: Rig) -> Rig:
    """Return the rig with the second camera as it truly is."""
    return PayloadMass(MASS - 0.26).apply(PayloadShift(*SHIFT.tolist()).apply(rig))


def record(rig: Rig, seed: int, seconds: float = 10.0, still: int | None = None) -> Log:
    """Return a log with 2 % of torque noise, in which one joint may stand still."""
    motion = fourier(rig, seed, seconds, 0.004)
    model = nominal(rig)
    q, v, a = (x.copy() for x in (motion.q, motion.v, motion.a))
    if still is not None:
        q[:, still], v[:, still], a[:, still] = 0.1, 0.0, 0.0
    tau = model.inverse(q, v, a)
    noise = (
        0.02
        * np.sqrt(np.mean(tau**2, axis=0))
        * np.random.default_rng(seed + 1).standard_normal(tau.shape)
    )
    return Log(f"log {seed}", rig.joints, motion.t, q, v, tau + noise)


def find_second(
    folder: Path, name: str, seed: int, *, at_once: bool = False, still: int | None = None
) -> Several:
    """Return what two logs show of the second camera, by a known gimbal or by both cameras at once."""
    path = write_gimbal(folder, name)
    first, second = (Rig.load(path, folder / f"{camera}.urdf") for camera in ("first", "second"))
    logs = [record(first, seed, 12.0)], [record(change_second(second), seed + 50, still=still)]
    if not at_once:
        known = identify(first, logs[0], filtering=ALIGNED, holdout="none").model
        return identify_new(second, logs[1], known, filtering=ALIGNED)
    pairs = ({"first": one, "second": other} for one, other in ((first, second), logs))
    return identify_several(*pairs, filtering=ALIGNED)


def compute_deviations(found: Several, mass: float | None) -> Array:
    """Return the errors of the second camera's place at its true mass, in standard deviations."""
    payloads = replace(found, mass=mass).payloads
    apart = payloads["second"].apart
    assert apart is not None
    shown = np.array(apart.shift.axes)
    std = apart.shift.std
    change = apart.shift.change
    assert shown[0]
    if (
        mass is None
    ):  # the first moment is that of the stated mass: m c = m_0 c_0 + (m - m_0) a, see `per_mass`
        assert not apart.found_mass and np.abs(apart.per_mass).max() > 1e-3
        change = change + apart.per_mass * (MASS - apart.stated) * apart.stated / MASS
    return np.asarray((change - SHIFT)[shown] / std[shown])


@pytest.mark.parametrize("name", list(GIMBALS))
def test_the_place_is_a_function_of_a_mass_that_does_not_show(tmp_path: Path, name: str) -> None:
    """At the true mass, with and without `mass`, over seeds: within three deviations, which are not too wide."""
    for mass in (None, MASS):
        z = np.concatenate(
            [compute_deviations(find_second(tmp_path, name, seed), mass) for seed in range(3)]
        )
        assert np.abs(z).max() < 3 and 0.1 < np.sqrt(np.mean(z**2)) < 1.6


@pytest.mark.parametrize("name", list(GIMBALS))
def test_both_cameras_at_once_show_the_same(tmp_path: Path, name: str) -> None:
    found = find_second(tmp_path, name, 0, at_once=True)
    assert np.abs(compute_deviations(found, None)).max() < 3
    assert any("camera.m" in note for note in found.identified["second"].notes) == (
        name != "two axes"
    )


@pytest.mark.parametrize("at_once", [False, True])
@pytest.mark.parametrize(
    ("name", "still"), [("concentric at a fixed tilt", 1), ("two axes", 0), ("two axes", 1)]
)
def test_a_joint_that_stands_still_hides_only_what_it_hides(
    tmp_path: Path, name: str, still: int, at_once: bool
) -> None:
    """What the other joints show is said, with deviations that hold the hidden directions, which are named."""
    found = find_second(tmp_path, name, 0, at_once=at_once, still=still)
    assert np.abs(compute_deviations(found, MASS)).max() < 3
    assert any("does not show" in note for note in found.identified["second"].notes)


def test_a_log_without_motion_shows_nothing(tmp_path: Path) -> None:
    path = write_gimbal(tmp_path, "two axes")
    first, second = (Rig.load(path, tmp_path / f"{camera}.urdf") for camera in ("first", "second"))
    known = identify(first, [record(first, 0)], filtering=ALIGNED, holdout="none").model
    log = record(second, 1)
    at_rest = replace(log, q=0 * log.q + 0.1, v=0 * log.q, tau=0 * log.q + log.tau[0])  # type: ignore[index]
    with pytest.raises(DataError):
        identify_new(second, [at_rest], known, filtering=ALIGNED)


def test_the_command_line_takes_the_weighed_mass(run: Run, tmp_path: Path) -> None:
    rig = write_gimbal(tmp_path, "concentric at a fixed tilt")
    model = tmp_path / "model.yaml"
    for k, camera in enumerate(("first", "second")):
        loaded = Rig.load(rig, tmp_path / f"{camera}.urdf")
        write_log(record(change_second(loaded) if k else loaded, k), tmp_path / f"{camera}.csv")
    exact = ("--alignment", "0")
    result(
        run,
        "identify",
        rig,
        f"{tmp_path}/first.csv",
        "--payload",
        tmp_path / "first.urdf",
        *exact,
        "-o",
        model,
    )
    second = f"{tmp_path}/second.csv@{tmp_path}/second.urdf"
    (found,) = result(run, "identify", rig, second, *exact, "--known", model, "--mass", str(MASS))[
        "payloads"
    ].values()
    row = found["given_model"]["camera"]
    assert row["weighed"] and row["mass"] == pytest.approx(1e3 * (MASS - 0.26))
    for value, std, true in zip(row["com_mm"], row["com_std_mm"], 1e3 * SHIFT):
        assert value == pytest.approx(true, abs=3 * std)
    assert any("camera.m" in note for note in found["notes"])
