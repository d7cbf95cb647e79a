"""Files that name each other work from any folder, and a motion for a controller of any rate."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import tune
from gimbal_pin.control.experiment import interpolate_motion
from gimbal_pin.dynamics import nominal
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import FrictionDrift, Term
from gimbal_pin.identification import identify
from gimbal_pin.log import Motion
from gimbal_pin.log.io import read_log, write_motion
from gimbal_pin.rig import Rig
from gimbal_pin.rig.files import bundled
from tests.bench_logs import EXACT, fourier, prescribed
from tests.command_line import Run

RIG = "urdf: turret\npayload: {}\nimus: [base, camera]\nnoise: {{gyro: 1.0e-5, accelerometer: 1.0e-3}}\n"


@pytest.mark.parametrize("payload", ["cam.urdf", "cameras/cam.urdf", "../cam.urdf"])
def test_a_rig_with_a_payload_of_its_own_is_tracked_from_any_folder(
    payload: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = tmp_path / "made" / "rig.yaml"
    other = tmp_path / "other"
    rig.parent.mkdir()
    other.mkdir()
    (rig.parent / payload).parent.mkdir(exist_ok=True)
    shutil.copy(bundled() / "payloads" / "infrared.urdf", rig.parent / payload)
    rig.write_text(RIG.format(payload))
    tune(nominal(Rig.load(rig))).save(tmp_path / "c.yaml")
    monkeypatch.chdir(other)
    calls = ["simulate {} --platform S --imus --seconds 8 -o shaken.csv"]
    held = "--platform-log shaken.csv --learn shaken.csv --plants 1 --seeds 1 --seconds 1"
    for call in (*calls, f"track {{}} {tmp_path / 'c.yaml'} {held}"):
        code, _, err = run(*call.format(rig).split())
        assert code == 0, err


@pytest.mark.parametrize(("control", "motion"), [(2e-3, 1e-3), (4e-3, 1e-3), (1e-3, 2e-3)])
def test_a_motion_is_interpolated_to_the_controller_s_rate(
    control: float, motion: float, run: Run, tmp_path: Path
) -> None:
    rig = Rig.load("turret")
    tune(nominal(rig), dt=control, bandwidth_hz=4.0).save(tmp_path / "c.yaml")
    asked = fourier(rig, 1, 2.0, motion)
    write_motion(asked, rig.joints, tmp_path / "x.csv")
    call = [
        "simulate",
        "turret",
        "--controller",
        tmp_path / "c.yaml",
        "--reference",
        tmp_path / "x.csv",
    ]
    code, _, err = run(*call, "-o", tmp_path / "s.csv")
    assert code == 0 and "interpolated" in err
    log = read_log(tmp_path / "s.csv", rig)
    assert log.dt == pytest.approx(control)
    few = max(1, round(motion / control))
    many = max(1, round(control / motion))
    assert np.abs(log.q_ref[::few] - asked.q[::many]).max() < 1e-9


def test_an_interpolated_motion_has_the_rates_of_its_angles() -> None:
    rig = Rig.load("turret")
    exact = fourier(rig, 2, 2.0, 1e-3)
    found = interpolate_motion(
        Motion(*(x[::5] for x in (exact.t, exact.q, exact.v, exact.a))), 1e-3
    )
    for got, right, size in zip(
        (found.q, found.v, found.a), (exact.q, exact.v, exact.a), (1e-8, 1e-5, 1e-2)
    ):
        assert np.abs(got - right).max() < size


def add_drift(model: Model, size: float, correlation: float) -> Model:
    """A model with a friction drift of which a log says next to nothing: deviations of `size` N m and N m s/rad."""
    known = model.estimated
    assert known is not None
    count = len(known.theta)
    std = np.append(known.std, [size, size])
    shared = np.eye(count + 2)
    shared[:count, :count] = known.covariance / np.outer(known.std, known.std)
    shared[count:, 0] = shared[0, count:] = correlation
    estimated = replace(
        known,
        names=(*known.names, "pan.coulomb", "pan.viscous"),
        units=(*known.units, "N m", "N m s/rad"),
        theta=np.append(known.theta, [0.1, 0.0]),
        covariance=shared * np.outer(std, std),
    )
    terms = (*model.terms, Term(FrictionDrift("pan", 1e5), (0.1, 0.0)))
    return replace(model, terms=terms, estimated=estimated)


@pytest.mark.parametrize(("size", "correlation"), [(1e6, 0.3), (1e8, 0.3), (1e10, -0.2)])
def test_a_drift_that_no_log_shows_does_not_multiply_the_gain(
    size: float, correlation: float
) -> None:
    rig = Rig.load("turret")
    model = identify(rig, [prescribed(nominal(rig), 1, 8.0, 1e-3, 2e-3)], filtering=EXACT).model
    with_drift = tune(add_drift(model, size, correlation), disk_margin=0.5)
    without = tune(model, disk_margin=0.5)
    np.testing.assert_allclose(with_drift.bandwidth_hz, without.bandwidth_hz, rtol=0.02)
    np.testing.assert_allclose(np.array(with_drift.ratios), 1.0, atol=0.01)


def test_a_plain_pid_stands_beside_another_design_by_name(run: Run, tmp_path: Path) -> None:
    tune(nominal(Rig.load("turret")), kind="pid").save(tmp_path / "c.yaml")
    code, out, _ = run("track", "turret", tmp_path / "c.yaml", "--plants", "1")
    assert code == 0 and "PID with feed-forward error" in out
