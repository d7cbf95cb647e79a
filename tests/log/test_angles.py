"""Angles of encoders that start over, lie beyond the stops, or do not read zero at the URDF's zero."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import LogError
from gimbal_pin.log import Log, log_columns, read_log, write_columns, write_log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.rigs import bundled, spelled

TURN = 2 * np.pi


@pytest.fixture(scope="module")
def free() -> Rig:
    """A turret whose pan has no stops."""
    return spelled(
        bundled("turret").urdf.replace('name="pan" type="revolute"', 'name="pan" type="continuous"')
    )


@pytest.fixture(scope="module")
def log(free: Rig) -> Log:
    """Pan turns round twice and back."""
    still = prescribed(nominal(free), seconds=4.0, dt=4e-3)
    q = np.array(still.q)
    q[:, 0] = 0.5 + 4 * np.pi * np.sin(np.pi * still.t / 4) ** 2
    return replace(still, q=q, v=None, q_ref=q)


def recorded(log: Log, path: Path, pan: np.ndarray, **others: np.ndarray) -> Path:
    """Write a log whose pan reads so."""
    write_columns({**log_columns(log), "q_pan": pan, **others}, path)
    return path


@pytest.mark.parametrize(
    ("start", "unit"), [(-np.pi, 1.0), (0.0, 1.0), (0.0, 360 / TURN), (0.0, 4096 / TURN)]
)
@pytest.mark.parametrize("has_rates", [False, True])
def test_an_angle_that_starts_over_is_unwrapped_with_a_note(
    free: Rig, log: Log, tmp_path: Path, start: float, unit: float, has_rates: bool
) -> None:
    """At ± π, at a turn, at 360 degrees and at a full count, once the mapping makes it radians."""
    pan = np.round((np.mod(log.q[:, 0] - start, TURN) + start) * unit, 0 if unit > 100 else 6)
    rates = (
        {f"dq_{joint}": np.gradient(log.q[:, j], log.t) for j, joint in enumerate(log.joints)}
        if has_rates
        else {}
    )
    path = recorded(
        log, tmp_path / "wrapped.csv", pan, q_ref_pan=np.mod(log.q[:, 0], TURN), **rates
    )
    read = read_log(path, free, [f"q_pan=q_pan/{unit}"])
    assert np.diff(read.q[:, 0] - log.q[:, 0]) == pytest.approx(0.0, abs=2 / unit)
    assert read.q_ref is not None and read.q_ref[:, 0] == pytest.approx(read.q[:, 0], abs=2 / unit)
    assert any("q_pan" in note and "unwrapped" in note for note in read.events)


@pytest.mark.parametrize("period", [360.0, 4096.0])
def test_an_angle_that_starts_over_in_another_unit_is_refused_with_the_map(
    free: Rig, log: Log, tmp_path: Path, period: float
) -> None:
    path = recorded(log, tmp_path / "x.csv", np.mod(log.q[:, 0], TURN) * period / TURN)
    with pytest.raises(
        LogError, match=rf"starts over at {period:g}.*--map 'q_pan=q_pan\*2\*pi/{period:g}'"
    ):
        read_log(path, free)


@pytest.mark.parametrize("spoiled", ["many turns", "a spike", "samples lost", "a motor's shaft"])
def test_what_does_not_start_over_is_left_alone(
    free: Rig, log: Log, tmp_path: Path, spoiled: str
) -> None:
    pan = np.array(log.q[:, 0])
    kept = np.arange(len(log))
    if spoiled == "a spike":
        pan[300] += 5.0
    if spoiled == "samples lost":
        kept = np.setdiff1d(kept, np.arange(200, 500))
    if spoiled == "a motor's shaft":
        pan *= 30
    part = replace(log, q_ref=None).part(kept)
    read = read_log(recorded(part, tmp_path / "x.csv", pan[kept]), free)
    np.testing.assert_array_equal(read.q[:, 0], pan[kept])


@pytest.mark.parametrize(
    ("zero", "added"), [(np.pi, "- pi"), (-np.pi, r"\+ pi"), (TURN, r"- 2\*pi")]
)
def test_angles_beyond_the_limits_are_refused_with_their_offset(
    tmp_path: Path, zero: float, added: str
) -> None:
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=4.0, dt=4e-3)
    tilt = log.q[:, 1] + zero
    write_columns({**log_columns(log), "q_tilt": tilt}, tmp_path / "x.csv")
    with pytest.raises(
        LogError, match=rf"q_tilt: lies at .*--map 'q_tilt=q_tilt {added}'.*encoder_zero"
    ):
        read_log(tmp_path / "x.csv", rig)
    read = read_log(
        tmp_path / "x.csv",
        rig,
        [f"q_tilt=q_tilt - {zero}" if zero > 0 else f"q_tilt=q_tilt + {-zero}"],
    )
    assert read.q == pytest.approx(log.q, abs=1e-12)


@pytest.mark.parametrize(("turns", "added"), [(0.25, "- pi/2"), (-0.25, r"\+ pi/2")])
def test_an_encoder_that_is_mounted_a_quarter_turn_off_is_refused_with_it(
    turns: float, added: str, tmp_path: Path
) -> None:
    plain = bundled("turret")
    rig = replace(plain, limits=(plain.limits[0], replace(plain.limits[1], lower=-0.8, upper=0.8)))
    t = 4e-3 * np.arange(1000)
    q = {"q_pan": np.sin(3 * t), "q_tilt": 0.7 * np.sin(5 * t) + turns * TURN}
    write_columns({"t": t, **q, "tau_pan": np.sin(t), "tau_tilt": np.sin(t)}, tmp_path / "x.csv")
    with pytest.raises(LogError, match=rf"--map 'q_tilt=q_tilt {added}'"):
        read_log(tmp_path / "x.csv", rig)


@pytest.mark.parametrize("name", ["turret", "ptu"])
@pytest.mark.parametrize(("zero", "stated"), [(4.14, 0.0), (-3.9, 0.0), (2.4, -1.3)])
def test_an_unknown_zero_is_refused_with_the_interval_that_holds_it(
    name: str, zero: float, stated: float, tmp_path: Path
) -> None:
    plain = bundled(name)
    motors = (plain.motors[0], replace(plain.motors[1], encoder_zero=stated))
    limits = (plain.limits[0], replace(plain.limits[1], lower=-1.0, upper=1.2))
    rig = replace(plain, motors=motors, limits=limits)
    t = 4e-3 * np.arange(1000)
    q = np.column_stack([np.sin(3 * t), 0.9 * np.sin(5 * t)])
    columns = {
        "t": t,
        **{f"q_{joint}": x for joint, x in zip(rig.joints, (q + np.array([0.0, zero])).T)},
    }
    write_columns(
        {**columns, **{f"tau_{joint}": np.sin(t) for joint in rig.joints}}, tmp_path / "x.csv"
    )
    with pytest.raises(LogError) as refused:
        read_log(tmp_path / "x.csv", rig)
    text = str(refused.value)
    ends = re.search(r"may be ([-\d.]+) to ([-\d.]+) rad", text)
    assert (
        ends
        and float(ends[1]) < zero < float(ends[2])
        and "encoder_zero" in text
        and "--map" not in text
    )
    middle = (float(ends[1]) + float(ends[2])) / 2
    assert f"{middle:.3f}" not in text


def test_angles_partly_beyond_the_limits_are_noted(tmp_path: Path) -> None:
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=4.0, dt=4e-3)
    beyond = rig.stops[1][1] - np.median(log.q[:, 1])
    write_columns({**log_columns(log), "q_tilt": log.q[:, 1] + beyond}, tmp_path / "x.csv")
    assert any(
        "q_tilt" in note and "limits" in note for note in read_log(tmp_path / "x.csv", rig).events
    )


def test_an_encoders_zero_is_applied_once(tmp_path: Path) -> None:
    """On reading, after the mapping; what is written and simulated reads as the encoder does."""
    plain = bundled("turret")
    motors = (plain.motors[0], replace(plain.motors[1], encoder_zero=1.25))
    rig = replace(plain, motors=motors)
    log = prescribed(nominal(plain), seconds=1.0, dt=4e-3)
    counts = (log.q[:, 1] + 1.25) * 4096 / TURN
    write_columns({**log_columns(log), "counts": counts}, tmp_path / "x.csv")
    read = read_log(tmp_path / "x.csv", rig, ["q_tilt=counts*2*pi/4096"])
    assert read.q == pytest.approx(log.q, abs=1e-12)
    write_log(read, tmp_path / "again.csv")
    assert read_log(tmp_path / "again.csv", rig).q == pytest.approx(log.q, abs=1e-12)
    assert read_log(tmp_path / "again.csv", plain).q[:, 1] == pytest.approx(
        log.q[:, 1] + 1.25, abs=1e-12
    )


@pytest.mark.parametrize("name", ["turret", "thesis"])
def test_rates_that_have_changed_places_are_refused_with_the_map(name: str, tmp_path: Path) -> None:
    rig = bundled(name)
    log = prescribed(nominal(rig), seconds=8.0, dt=4e-3)
    columns = log_columns(log)
    first, other = rig.joints[:2]
    columns[f"dq_{first}"], columns[f"dq_{other}"] = columns[f"dq_{other}"], columns[f"dq_{first}"]
    write_columns(columns, tmp_path / "x.csv")
    with pytest.raises(LogError, match=rf"--map dq_{first}=dq_{other} --map dq_{other}=dq_{first}"):
        read_log(tmp_path / "x.csv", rig)
    read = read_log(tmp_path / "x.csv", rig, [f"dq_{first}=dq_{other}", f"dq_{other}=dq_{first}"])
    assert read.v == pytest.approx(log.v)


@pytest.mark.parametrize("factor", [0.5, 1.5, 2.0, 0.0])
def test_a_rate_that_is_not_its_angles_derivative_is_noted(factor: float, tmp_path: Path) -> None:
    """A multiple of it has the map that corrects it; the rate of anything else has none."""
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=8.0, dt=4e-3)
    rate = np.asarray(log.v)[:, 0] * factor if factor else np.sin(7 * log.t)
    write_columns({**log_columns(log), "dq_pan": rate}, tmp_path / "x.csv")
    (note,) = read_log(tmp_path / "x.csv", rig).events
    assert "dq_pan" in note and (
        f"--map 'dq_pan=dq_pan*{1 / factor:.3g}'" in note if factor else "not the der" in note
    )


@pytest.mark.parametrize("spoiled", ["noise", "a low-pass", "a delay"])
def test_rates_of_ordinary_sensors_are_not_noted(spoiled: str, tmp_path: Path) -> None:
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=8.0, dt=4e-3)
    v = np.array(log.v)
    if spoiled == "noise":
        v += np.random.default_rng(0).normal(0.0, 1.0, v.shape)
    if spoiled == "a low-pass":
        v = lfilter([0.08], [1.0, -0.92], v, axis=0)
    if spoiled == "a delay":
        v = np.roll(v, 6, axis=0)
    write_log(replace(log, v=v), tmp_path / "x.csv")
    assert not read_log(tmp_path / "x.csv", rig).events
