"""Angles, rates and torques that can be in no SI units, or that an encoder turned.

Laws: an angle that starts over is unwrapped, or refused with its map; one beyond the stops is
refused with its offset; rates are compared with their angles; the proposed map corrects each.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.errors import LogError
from gimbal_pin.log import Log, log_columns, read_log, write_log
from gimbal_pin.rig import Rig
from tests.log.planted import TURRET, agree, held, planted, write_csv
from tests.rigs import spelled

TURN = 2 * np.pi
T = np.arange(0, 8, 0.004)
LOG = planted(T)
V = held(LOG.v)
FREE = spelled(TURRET.urdf.replace('name="pan" type="revolute"', 'name="pan" type="continuous"'))
PAN = 0.5 + 4 * np.pi * np.sin(np.pi * T / 8) ** 2
"""An angle that turns round twice and back, rad."""


def read_changed(path: Path, rig: Rig = TURRET, mapping: object = (), **changed: object) -> Log:
    """Return the log with some columns changed, or left out where they are None."""
    columns = {**log_columns(LOG), **changed}
    kept = {name: x for name, x in columns.items() if x is not None}
    return read_log(write_csv(kept, path / "x.csv"), rig, mapping)  # type: ignore[arg-type]


def read_mended(refusal: LogError, path: Path, rig: Rig = TURRET) -> Log:
    """Return the log that is refused, read by the map that the refusal proposes."""
    entries = re.findall(r"--map (?:'([^']+)'|([^ ,;]+))", refusal.mend)
    return read_log(path / "x.csv", rig, [quoted or plain for quoted, plain in entries])


@pytest.mark.parametrize(
    ("start", "unit"), [(-np.pi, 1.0), (0.0, 1.0), (0.0, 360 / TURN), (0.0, 4096 / TURN)]
)
def test_an_angle_that_starts_over_is_unwrapped_or_refused_with_the_map(
    start: float, unit: float, tmp_path: Path
) -> None:
    """At ± pi, at a turn, at 360 degrees and at a full count, once the mapping makes it radians."""
    pan = (np.mod(PAN - start, TURN) + start) * unit
    changed = {"q_pan": pan, "dq_pan": np.gradient(PAN, T), "q_ref_pan": np.mod(PAN, TURN)}
    changed["q_ref_tilt"] = LOG.q[:, 1]
    log = read_changed(tmp_path, FREE, f"q_pan=q_pan/{unit}", **changed)
    assert "unwrapped" in log.events[0]
    np.testing.assert_allclose(held(log.q_ref)[:, 0], log.q[:, 0], atol=1e-9)
    logs = [log]
    if unit > 1.0:
        with pytest.raises(LogError, match=f"starts over at {TURN * unit:g}") as caught:
            read_changed(tmp_path, FREE, **changed)
        logs.append(read_mended(caught.value, tmp_path, FREE))
    for log in logs:
        np.testing.assert_allclose(np.diff(log.q[:, 0] - PAN), 0.0, atol=1e-9)


@pytest.mark.parametrize("pan", [PAN, 30 * PAN, PAN + 5.0 * (T[300] == T), PAN + TURN * (T > 100)])
def test_what_does_not_start_over_is_left_alone(pan: np.ndarray, tmp_path: Path) -> None:
    """Many turns, a motor's shaft, a spike."""
    log = read_changed(tmp_path, FREE, q_pan=pan, dq_pan=None, dq_tilt=None)
    np.testing.assert_array_equal(log.q[:, 0], pan)


def limit_tilt(lower: float, upper: float, zero: float = 0.0) -> Rig:
    """Return the turret with other stops and another encoder's zero of its tilt."""
    motors = (TURRET.motors[0], replace(TURRET.motors[1], encoder_zero=zero))
    limits = (TURRET.limits[0], replace(TURRET.limits[1], lower=lower, upper=upper))
    return replace(TURRET, motors=motors, limits=limits)


@pytest.mark.parametrize("zero", [np.pi, -np.pi, TURN, np.pi / 2])
def test_angles_beyond_the_limits_are_refused_with_their_offset(
    zero: float, tmp_path: Path
) -> None:
    rig = limit_tilt(-0.8, 0.8)
    tilt = 0.5 * LOG.q[:, 1]
    with pytest.raises(LogError, match=r"q_tilt: lies at .*encoder_zero") as caught:
        read_changed(tmp_path, rig, q_tilt=tilt + zero)
    log = read_mended(caught.value, tmp_path, rig)
    np.testing.assert_allclose(log.q[:, 1], tilt, atol=1e-12)


@pytest.mark.parametrize(("zero", "stated"), [(4.14, 0.0), (-3.9, 0.0), (2.4, -1.3)])
def test_an_unknown_zero_is_refused_with_the_interval_that_holds_it(
    zero: float, stated: float, tmp_path: Path
) -> None:
    """A travel of 1.8 rad between stops 2.2 rad apart leaves 0.4 rad."""
    rig = limit_tilt(-1.0, 1.2, stated)
    tilt = 0.9 * np.sin(5 * T) + zero
    with pytest.raises(LogError, match="encoder_zero") as caught:
        read_changed(tmp_path, rig, q_tilt=tilt, dq_tilt=4.5 * np.cos(5 * T))
    ((low, high),) = re.findall(r"may be ([-\d.]+) to ([-\d.]+) rad", str(caught.value))
    assert (float(low), float(high)) == pytest.approx((zero - 0.3, zero + 0.1), abs=0.02)
    assert "--map" not in str(caught.value)


def test_an_encoders_zero_is_applied_once(tmp_path: Path) -> None:
    """On reading, after the mapping; what is written reads as the encoder does."""
    rig = replace(limit_tilt(0.0, 0.0, 1.25), limits=TURRET.limits)
    counts = (LOG.q[:, 1] + 1.25) * 4096 / TURN
    log = read_changed(tmp_path, rig, "q_tilt=counts*2*pi/4096", counts=counts)
    again = tmp_path / "again.csv"
    write_log(log, again)
    shifted = read_log(again, TURRET)
    for found, zero in ((log, 0.0), (read_log(again, rig), 0.0), (shifted, 1.25)):
        np.testing.assert_allclose(found.q, LOG.q + np.array([0.0, zero]), atol=1e-12)
    assert "limits" in " ".join(shifted.events)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"q_pan": np.degrees(LOG.q[:, 0])}, "q_pan travels .*degrees"),
        ({"dq_pan": np.degrees(V[:, 0])}, "dq_pan says.*degrees"),
        ({"t": 1e3 * T}, "t is in ms"),
        ({"dq_pan": -V[:, 0]}, "dq_pan is negative where q_pan rises"),
        ({"dq_pan": V[:, 1], "dq_tilt": V[:, 0]}, "rates of each other's joints"),
    ],
)
def test_what_can_be_no_si_unit_is_refused_with_the_map(
    changed: dict[str, np.ndarray], said: str, tmp_path: Path
) -> None:
    with pytest.raises(LogError, match=said) as caught:
        read_changed(tmp_path, **changed)
    agree(read_mended(caught.value, tmp_path), LOG, 0.01 * np.abs(V).max())


NOISE = np.random.default_rng(0).normal(size=len(T))


@pytest.mark.parametrize(
    ("pan", "rate", "said"),
    [
        (LOG.q[:, 0], 0.5 * V[:, 0], "--map 'dq_pan=dq_pan*2'"),
        (LOG.q[:, 0], 1.5 * V[:, 0], "--map 'dq_pan=dq_pan*0.667'"),
        (LOG.q[:, 0], np.sin(7 * T), "dq_pan is not the derivative"),
        (LOG.q[:, 0], V[:, 0] + NOISE, ""),
        (LOG.q[:, 0], np.roll(V[:, 0], 6), ""),
        (0.1 * np.round(LOG.q[:, 0] / 0.1), V[:, 0], ""),
        (0 * T, 0.1 * NOISE, ""),
    ],
)
def test_a_rate_that_is_not_its_angles_derivative_is_noted(
    pan: np.ndarray, rate: np.ndarray, said: str, tmp_path: Path
) -> None:
    """Noise, a delay, coarse steps and a joint that stands are not."""
    events = read_changed(tmp_path, q_pan=pan, dq_pan=rate).events
    assert len(events) == bool(said)
    assert said in "".join(events)


def test_a_joint_that_its_loop_has_lost_is_no_matter_of_units(tmp_path: Path) -> None:
    """It leaves its limits where the reference stays within them."""
    pan = LOG.q[:, 0]
    references = {"q_ref_pan": pan, "q_ref_tilt": LOG.q[:, 1]}
    with pytest.raises(LogError, match="the loop lost the joint"):
        read_changed(tmp_path, q_pan=pan + T**2, dq_pan=V[:, 0] + 2 * T, **references)
    assert read_changed(tmp_path, **references).events == ()


@pytest.mark.parametrize(
    ("tau", "said"),
    [
        (1.2 * np.sin(T), ""),
        (1e3 * np.sin(T), "motor's limit is"),
        (1.0 * (0.4 * T[-1] > T), ""),
        (1.0 * (0.7 * T[-1] > T), "70 % of the time"),
    ],
)
def test_torques_beyond_the_motor_or_at_its_limit_are_noted(
    tau: np.ndarray, said: str, tmp_path: Path
) -> None:
    events = read_changed(tmp_path, tau_pan=float(TURRET.tau_max[0]) * tau).events
    assert len(events) == bool(said)
    assert said in " ".join(events)
