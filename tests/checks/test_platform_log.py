"""The log of a platform's IMU: what is frozen, missing or in other units is told, left out or refused."""

from __future__ import annotations

from functools import cache

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
    noise = rng.standard_normal((2, N, 3))
    return t, moved.w + 1e-3 * noise[0], moved.f + 1e-2 * noise[1]


def notes_of(t: Array, gyro: Array, accel: Array) -> str:
    """Return what is said of a log, in one text."""
    return " | ".join(check_platform_log(t, Imu(gyro, accel), "ride.csv")[2])


@given(st.integers(100, 1200), st.integers(10, 200), st.sampled_from([0, 1]))
def test_frozen_readings_are_told_and_nothing_of_them_is_used(
    first: int, count: int, sensor: int
) -> None:
    t, gyro, accel = (x.copy() for x in motion())
    gyro[:, 2] = 0.5 + np.abs(gyro[:, 2])  # it turns all the time: who stands may repeat himself
    held = (gyro, accel)[sensor]
    held[first : first + count] = held[first - 1]
    kept, _, notes = check_platform_log(t, Imu(gyro, accel), "ride.csv")
    assert "repeats itself once" in notes[0]
    assert f"from {t[first - 1]:.4g} s" in notes[0]
    assert not np.isin(t[first : first + count], kept).any()
    is_bridged = (count + 1) * DT <= 0.25
    assert len(kept) == (N - count if is_bridged else max(first, N - first - count))


def test_one_axis_that_is_stuck_is_told_and_a_coarse_one_or_a_pause_is_not() -> None:
    t, gyro, accel = (x.copy() for x in motion())
    coarse = np.round(gyro / 0.05) * 0.05
    assert "gyro" not in notes_of(t, coarse, accel)
    stuck = gyro.copy()
    stuck[600:700, 1] = gyro[600, 1]
    assert "the gyro repeats itself once for 0.8" in notes_of(t, stuck, accel)
    gyro[400:700] = 0.0
    accel[400:700] = [0.0, 0.0, 9.81]
    kept, imu, notes = check_platform_log(t, Imu(gyro, accel), "ride.csv")
    assert notes == ()
    np.testing.assert_array_equal(kept, t)
    np.testing.assert_array_equal(imu.accel, accel)


def test_gaps_are_told_and_of_long_ones_the_longest_stretch_between_is_used() -> None:
    t, gyro, accel = motion()
    keep = np.ones(N, dtype=bool)
    keep[200:220] = False  # 0.17 s
    assert "1 gap of up to 0.168 s" in notes_of(t[keep], gyro[keep], accel[keep])
    keep[500:600] = False  # 0.81 s
    kept, imu, (note, *_) = check_platform_log(t[keep], Imu(gyro[keep], accel[keep]), "a")
    np.testing.assert_array_equal(kept, t[600:])
    np.testing.assert_array_equal(imu.gyro, gyro[600:])
    assert "1 gap of more than 0.25 s, up to 0.808 s" in note


@pytest.mark.parametrize(
    ("rows", "gyro", "accel", "words"),
    [
        (np.arange(N), 0.25, 1.0, "gyro never changes"),
        (np.arange(N), 1.0, 1 / 9.81, r"9\.81 where it is in g"),
        (np.flatnonzero(np.arange(N) % 150 < 100), 1.0, 1.0, "no 2 s in a row"),
    ],
)
def test_what_nobody_can_be_carried_along_is_refused_with_the_mend(
    rows: Array, gyro: float, accel: float, words: str
) -> None:
    t, w, f = (x[rows] for x in motion())
    w = np.full_like(w, gyro) if gyro < 1 else w
    with pytest.raises(LogError, match=words):
        check_platform_log(t, Imu(w, f * accel), "a")


def test_what_is_unlikely_is_told() -> None:
    t, gyro, accel = motion()
    assert "the platform stands" in notes_of(t, 0 * gyro, np.full_like(accel, 5.66))
    assert "pi/180" in notes_of(t, gyro * 57.3, accel)
    assert "sampled at 25 Hz" in notes_of(t[::5], gyro[::5], accel[::5])
