"""Torques of models along logs: what a true model leaves is noise, whatever its drives do and the log lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.control import bench_run
from gimbal_pin.diagnosis import diagnose, limit_band, trace_torques
from gimbal_pin.diagnosis.traces import (
    build_model_rows,
    compute_torque_error,
    measure_torque_rmse,
)
from gimbal_pin.dynamics import Estimated, Model, nominal
from gimbal_pin.dynamics.apply import plant_with
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.log import Array, Log
from tests.bench_logs import prescribed
from tests.rigs import bundled

RIG = bundled("turret")
NOISE = 5e-3
"""Noise of the torque, N m."""


@pytest.mark.parametrize(
    ("cause", "most"),
    [
        ("saturation:pan:limit=0.15", 0.01),
        ("dead-zone:pan:width=0.05", 0.1),
        ("delay:pan:time=0.008", 0.5),
        ("actuator-lag:pan:time_constant=0.01", 0.5),
        ("backlash:pan:gap=0.005,inertia=0.002", 0.7),
        ("torque-gain:pan:gain=1.2", 0.1),
        ("base-tilt::roll=0.1", 0.2),
    ],
)
def test_a_model_with_its_drive_leaves_less_than_without(cause: str, most: float) -> None:
    planted = plant_with(nominal(RIG), [parse_effect(cause, RIG)])
    model = replace(planted.plant, drive=planted.drive)
    log = bench_run(planted.plant, rng=0, seconds=15.0, drive=planted.drive)
    without, true = (measure_residual(one, log) for one in (nominal(RIG), model))
    assert true[0] < most * without[0]
    assert true[0] == pytest.approx(0.0038, rel=0.2)


def measure_residual(model: Model, log: Log) -> Array:
    """Return the rms of what a model leaves of the torque where the joint turns, N m, (n,)."""
    trace = trace_torques(model, log)
    inside = (trace.t > log.t[0] + 1.0) & (trace.t < log.t[-1] - 1.0)
    counted = (np.abs(trace.v) > 0.1) & inside[:, None]
    return np.sqrt(np.mean(trace.residual**2, axis=0, where=counted))


def test_samples_that_were_not_measured_are_left_out() -> None:
    whole = prescribed(nominal(RIG), seconds=10.0, dt=4e-3)
    is_kept = np.ones(len(whole.t), bool)
    is_kept[1000:1006] = False
    trace = trace_torques(nominal(RIG), whole.part(is_kept))
    inside = (trace.t > whole.t[1000]) & (trace.t < whole.t[1005])
    assert not inside.any()
    assert len(trace.t) > 0.98 * len(whole.t)


def test_errors_of_a_true_model_are_the_noise_of_the_band() -> None:
    log = prescribed(nominal(RIG), seconds=20.0, dt=4e-3)
    noise = NOISE * np.random.default_rng(1).standard_normal(log.q.shape)
    log = replace(log, tau=np.asarray(log.tau) + noise)
    filtering = replace(limit_band([log]), alignment=0.0)
    rows = build_model_rows(nominal(RIG), [log], filtering)
    passed = 0.85 * 2 * filtering.cutoff * log.dt
    assert measure_torque_rmse(rows, nominal(RIG)) == pytest.approx(NOISE * passed**0.5, rel=0.25)
    assert compute_torque_error(rows, nominal(RIG)).shape == (len(rows.inner), RIG.n)


def test_a_torque_stands_when_the_model_says_that_it_acts() -> None:
    """The lag is one to the model's joint alone."""
    true = nominal(RIG)
    log = prescribed(true, seconds=20.0, dt=4e-3)
    filtering = replace(limit_band([log]), alignment=0.0)
    assert log.tau is not None
    early = np.interp(log.t + 0.01, log.t, log.tau[:, 0])
    shifted = replace(log, tau=np.column_stack([early, log.tau[:, 1]]))
    known = Estimated((), (), np.zeros(0), np.zeros((0, 0)), lags=(0.01, 0.0))
    models = (true, replace(true, estimated=known))
    before, after = (
        measure_torque_rmse(build_model_rows(model, [shifted], filtering), model)
        for model in models
    )
    assert after[0] < 0.1 * before[0]
    assert after[1] == pytest.approx(before[1])


def test_a_diagnosis_takes_the_torque_when_it_is_said_to_act() -> None:
    log = bench_run(nominal(RIG), rng=0, seconds=20.0)
    early = [np.interp(log.t + 0.05, log.t, column) for column in np.asarray(log.tau).T]
    stamped = replace(log, tau=np.column_stack(early))
    filtering = replace(limit_band([stamped]), alignment=0.05 + log.dt / 2)
    found = diagnose(RIG, stamped, filtering=filtering)
    assert found.verdict == "nothing"
    assert all(abs(late) < 2e-3 for late in found.alignment.values())
