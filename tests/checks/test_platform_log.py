"""The log of a platform's IMU: what is frozen, missing or in other units is told, left out or refused."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.checks import check_platform_log
from gimbal_pin.errors import LogError
from gimbal_pin.log import Array, Imu, profile_s

DT, N = 0.008, 1500


@cache
def motion() -> tuple[Array, Array, Array]:
    """Twelve seconds of profile S at 125 Hz, with a little noise: time, gyro, accelerometer."""
    t = DT * np.arange(N)
    rng = np.random.default_rng(3)
    moved = profile_s(t, np.random.default_rng(2))
    return (
        t,
        moved.w + 1e-3 * rng.standard_normal((N, 3)),
        moved.f + 1e-2 * rng.standard_normal((N, 3)),
    )


def test_a_sound_log_passes_as_it_is() -> None:
    t, gyro, accel = motion()
    kept, imu, notes = check_platform_log(t, Imu(gyro, accel), "ride.csv")
    assert notes == ()
    np.testing.assert_array_equal(kept, t)
    np.testing.assert_array_equal(imu.accel, accel)


@given(st.integers(100, 1200), st.integers(10, 200), st.sampled_from(["gyro", "accel"]))
def test_frozen_readings_are_told_and_nothing_of_them_is_used(
    first: int, count: int, sensor: str
) -> None:
    t, gyro, accel = (x.copy() for x in motion())
    gyro[:, 2] = 0.5 + np.abs(
        gyro[:, 2]
    )  # it turns all the time: whoever stands may repeat himself
    held = gyro if sensor == "gyro" else accel
    held[first : first + count] = held[first - 1]
    kept, _, notes = check_platform_log(t, Imu(gyro, accel), "ride.csv")
    assert (
        "repeats itself once" in notes[0]
        and f"from {t[first - 1]:.4g} s" in notes[0]
        and "ride.csv" in notes[0]
    )
    assert not np.isin(t[first : first + count], kept).any()
    bridged = (count + 1) * DT <= 0.25
    assert len(kept) == N - count if bridged else len(kept) == max(first, N - first - count)


def test_one_axis_that_is_stuck_is_told_too_and_a_coarse_one_is_not() -> None:
    t, gyro, accel = (x.copy() for x in motion())
    gyro[600:700, 1] = gyro[600, 1]
    assert (
        "the gyro repeats itself once for 0.8" in check_platform_log(t, Imu(gyro, accel), "a")[2][0]
    )
    coarse = np.round(motion()[1] / 0.05) * 0.05
    assert not any("gyro" in note for note in check_platform_log(t, Imu(coarse, accel), "a")[2])


def test_a_platform_that_pauses_is_not_frozen() -> None:
    t, gyro, accel = (x.copy() for x in motion())
    gyro[400:700], accel[400:700] = 0.0, [0.0, 0.0, 9.81]
    assert check_platform_log(t, Imu(gyro, accel), "a").notes == ()


def test_gaps_are_told_and_of_long_ones_the_longest_stretch_between_is_used() -> None:
    t, gyro, accel = motion()
    keep = np.ones(N, dtype=bool)
    keep[200:220] = keep[500:600] = False  # 0.17 s and 0.81 s
    kept, imu, notes = check_platform_log(t[keep], Imu(gyro[keep], accel[keep]), "a")
    assert (
        kept[0] == t[600]
        and kept[-1] == t[-1]
        and imu.gyro is not None
        and len(imu.gyro) == len(kept)
    )
    assert "1 gap of more than 0.25 s, up to 0.808 s" in notes[0] and "4.8 to 11.99 s" in notes[0]
    keep[500:600] = True
    (note,) = check_platform_log(t[keep], Imu(gyro[keep], accel[keep]), "a")[2]
    assert "1 gap of up to 0.168 s" in note and "interpolated" in note


def test_what_nobody_can_be_carried_along_is_refused_with_the_mend() -> None:
    t, gyro, accel = motion()
    with pytest.raises(LogError, match="gyro never changes"):
        check_platform_log(t, Imu(np.ones_like(gyro), accel), "a")
    with pytest.raises(LogError, match=r"9\.81 where it is in g"):
        check_platform_log(t, Imu(gyro, accel / 9.81), "a")
    keep = np.arange(N) % 150 < 100  # 0.8 s, then 0.4 s of nothing
    with pytest.raises(LogError, match="no 2 s in a row"):
        check_platform_log(t[keep], Imu(gyro[keep], accel[keep]), "a")
    with pytest.raises(
        LogError, match="gyro never changes"
    ):  # and never did: no platform turns so evenly
        check_platform_log(t, Imu(np.full_like(gyro, 0.25), np.full_like(accel, 5.66)), "a")
    assert (
        "the platform stands"
        in check_platform_log(t, Imu(0 * gyro, np.full_like(accel, 5.66)), "a")[2][0]
    )
    assert "pi/180" in check_platform_log(t, Imu(gyro * 57.3, accel), "a")[2][0]
    assert "sampled at 25 Hz" in check_platform_log(t[::5], Imu(gyro[::5], accel[::5]), "a")[2][0]


def test_the_command_line_tells_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from gimbal_pin.cli.inputs import read_platform
    from gimbal_pin.log import write_columns
    from gimbal_pin.rig import Rig

    rig = Rig.load("turret")
    t, gyro, accel = (x.copy() for x in motion())
    gyro[300:320] = gyro[299]
    columns = {"t": t} | {f"gyro_{rig.base}_{axis}": x for axis, x in zip("xyz", gyro.T)}
    columns |= {f"accel_{rig.base}_{axis}": x for axis, x in zip("xyz", accel.T)}
    write_columns(columns, tmp_path / "ride.csv")
    ridden = read_platform(rig, "none", tmp_path / "ride.csv", ())
    assert ridden is not None and len(ridden) == N - 20
    assert "note:" in (told := capsys.readouterr().err) and "the gyro repeats itself once" in told
