"""The blind set's drives and people: sensors obey their laws, arms are real, and visibility is right in colour."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import yaml
from scipy.signal import welch

from tests.blind.arm_draw import draw_arm, locked
from tests.blind.cases import Case, hide
from tests.blind.coloured import Spectrum, size
from tests.blind.draw import sample
from tests.blind.drive_draw import ALIGNED
from tests.blind.drive_log import show, written
from tests.blind.drive_noise import Colour
from tests.blind.drive_sensors import FARTHEST, DriveReading, DriveSensors, draw_drive_sensors
from tests.blind.effects import CATALOGUE
from tests.blind.excitation import Reference
from tests.blind.files import write
from tests.blind.habits import Habit, repeated, turning_path
from tests.blind.mjcf import Base, build
from tests.blind.people import CLEAR_OF_IT, clear_of_alignment
from tests.blind.plan import DRIVE_STRATA, STRATA, VARIANTS, DrivePlan, Hidden, Plan
from tests.blind.plant import Trace
from tests.blind.rig_draw import draw_rig
from tests.blind.rigs import Array, point_mass
from tests.blind.rnea import inverse_dynamics
from tests.blind.scene import Scene
from tests.blind.world import World

RATE = 500.0
OLD_PLANS = {
    "clean": "9152d520a8cf", "single": "b1a09c7cc84c", "pair": "4374c0a84ea0", "outside": "98803798481a",
    "data": "796ed48e76d1", "mismatched": "0108012d7e78",
}  # fmt: skip


def sensors_of(**changed: object) -> DriveSensors:
    """A drive's sensors with nothing wrong but what is asked for."""
    quiet = {
        "encoder_bits": 17, "encoder_noise": 0.0, "noise_share": 0.0, "torque_step": 2.0**-16, "torque_every": 1,
        "angle_late": 0.0, "torque_late": 0.0, "jitter": 0.0, "lost": 0.0, "repeated": 0.0, "rate_step": 0.0,
        "has_rate": True, "current_hz": 100.0,
    }  # fmt: skip
    return replace(draw_drive_sensors(np.random.default_rng(0), RATE, False), **(quiet | changed))  # type: ignore[arg-type]


def rough(x: Array, seed: int) -> Array:
    """Sines of 0.2–6 Hz as a signal of time x (N,)."""
    rng = np.random.default_rng(seed)
    hertz = np.exp(rng.uniform(np.log(0.2), np.log(6.0), 12))
    return np.asarray(
        np.sin(2.0 * np.pi * hertz * x[:, None] + rng.uniform(-3.0, 3.0, 12)).sum(axis=1)
    )


def run_of(sensors: DriveSensors, seconds: float = 10.0) -> tuple[Scene, Trace]:
    """A made-up run of one axis: angles as they are, and a command of the same sines."""
    rig = draw_rig(np.random.default_rng(1), 1)
    t = np.arange(round(seconds * RATE)) / RATE
    q = rough(t, 3)[:, None]
    command = rough(t, 4)[:, None]
    none = np.zeros((len(t), 1))
    trace = Trace(t, q, none, q, none, command, *(6 * [none]))
    return Scene(rig, Reference(t, q, q, q, none), None, none, sensors, RATE, 1), trace  # type: ignore[arg-type]


def lateness(shown: Array, true: Array, furthest: int = 40) -> float:
    """Where the cross-correlation of two series peaks, s; between samples by a parabola."""
    inner = slice(furthest, -furthest)
    lags = np.arange(-furthest, furthest + 1)
    error = np.array([np.mean((shown[inner] - np.roll(true, lag)[inner]) ** 2) for lag in lags])
    k = int(error.argmin())
    low, mid, high = error[k - 1 : k + 2]
    return float((lags[k] + 0.5 * (low - high) / (low - 2.0 * mid + high)) / RATE)


# sensors -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("phi", [0.9, 0.99])
def test_autoregressive_noise_has_its_phi_and_its_spectrum(phi: float) -> None:
    colour = Colour("ar1", phi, 1.0)
    x = colour.series(np.random.default_rng(0), (200_000, 1), RATE)[:, 0]
    assert x.std() == pytest.approx(1.0, rel=0.1)
    assert np.mean(x[1:] * x[:-1]) / np.mean(x**2) == pytest.approx(phi, abs=0.01)
    hertz, power = welch(x, RATE, nperseg=4096)
    band = (hertz > 0.5) & (hertz < 20.0)
    assert np.median(power[band] / colour.density(hertz[band], RATE)) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("corner", [0.5, 15.0])
def test_low_pass_noise_ends_at_its_corner(corner: float) -> None:
    colour = Colour("low-pass", 0.9, corner)
    x = colour.series(np.random.default_rng(0), (200_000, 1), RATE)
    hertz, power = welch(x[:, 0], RATE, nperseg=2**15)
    assert power[hertz > 4.0 * corner].sum() / power.sum() < 0.01
    at = colour.density(np.array([1e-6, corner]), RATE)
    assert at[1] / at[0] == pytest.approx(0.5, rel=0.01)
    fine = np.linspace(0.0, 0.5 * RATE, 200_001)
    assert np.trapezoid(colour.density(fine, RATE), fine) == pytest.approx(1.0, rel=1e-3)


def test_the_reported_current_is_a_first_order_low_pass() -> None:
    sensors = sensors_of(current_hz=20.0)
    step = np.concatenate([np.zeros((10, 1)), np.ones((100, 1))])
    shown = sensors.reported(step, RATE)[10:, 0]
    np.testing.assert_allclose(
        shown, 1.0 - np.exp(-2.0 * np.pi * 20.0 * np.arange(100) / RATE), atol=1e-12
    )
    assert sensors.passed(np.array([20.0]))[0] == pytest.approx(0.5)


@pytest.mark.parametrize("seed", range(4))
def test_channels_are_as_far_apart_as_drawn(seed: int) -> None:
    drawn = draw_drive_sensors(np.random.default_rng(seed), RATE, False)
    sensors = sensors_of(
        **{
            k: getattr(drawn, k)
            for k in ("angle_late", "torque_late", "current_hz", "torque_every")
        }
    )
    scene, trace = run_of(sensors)
    shown = show(sensors, scene, trace, 1, np.random.default_rng(0)).channels
    angle = lateness(shown.q[:, 0], trace.q[:, 0])
    torque = lateness(shown.tau[:, 0], trace.command[:, 0])
    hold = 0.5 / RATE
    assert torque - angle - hold == pytest.approx(drawn.alignment, abs=0.6e-3)
    assert abs(drawn.alignment) <= FARTHEST


def test_torque_comes_in_steps_and_its_noise_has_its_share() -> None:
    sensors = sensors_of(noise_share=0.05, torque_step=2.0**-9)
    scene, trace = run_of(sensors)
    tau = show(sensors, scene, trace, 1, np.random.default_rng(0)).channels.tau
    steps = tau / (2.0**-9 * scene.rig.motors[0].tau_max)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    error = (tau - sensors.reported(trace.command, RATE)).std()
    assert error / np.sqrt(np.mean(trace.command**2)) == pytest.approx(0.05, rel=0.3)


def test_lost_and_repeated_rows_are_as_many_as_drawn() -> None:
    sensors = sensors_of(lost=0.01, repeated=0.02, jitter=2e-4)
    scene, trace = run_of(sensors)
    rng = np.random.default_rng(0)
    log = written(sensors, scene, show(sensors, scene, trace, 1, rng), {}, rng)
    assert 1.0 - len(log["t"]) / len(trace.t) == pytest.approx(0.01, rel=0.3)
    joint = scene.rig.joints[0]
    again = np.diff(log[f"tau_{joint}"]) == 0.0
    assert np.mean(again & (np.diff(log[f"q_{joint}"]) == 0.0)) == pytest.approx(0.02, rel=0.3)
    late = log["t"] - trace.t[log["#"].astype(int)]
    assert (np.diff(log["t"]) > 0.0).all()
    assert np.quantile(late, 0.68) == pytest.approx(2e-4, rel=0.1)


@pytest.mark.parametrize("law", ["observer", "difference"])
def test_rates_follow_the_encoder_at_their_bandwidth(law: str) -> None:
    sensors = sensors_of(rate_law=law, rate_hz=30.0, encoder_bits=16)
    world = World(draw_rig(np.random.default_rng(1), 1), (), 1.0 / RATE, 4.0)
    t = np.arange(round(4.0 * RATE)) / RATE
    read = DriveReading(world, sensors, len(t), np.random.default_rng(0))
    q = np.sin(2.0 * np.pi * t)
    v = 2.0 * np.pi * np.cos(2.0 * np.pi * t)
    rates = np.array([read(k, [q[k]], [v[k]])[1][0] for k in range(len(t))])
    late = lateness(rates, v)
    expected = (
        1.6 / (2.0 * np.pi * 30.0) if law == "observer" else 0.5 / (np.pi * 30.0) + 0.5 / RATE
    )
    assert late == pytest.approx(expected, abs=1.5e-3)
    assert np.abs(rates[200:] - np.interp(t - late, t, v)[200:]).max() < 0.15


# arms and habits -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", range(1, 8))
def test_an_arms_inverse_dynamics_is_mujocos(axes: int) -> None:
    rig = draw_arm(np.random.default_rng(axes), axes)
    model = build(rig, (), Base.FIXED, point_mass(1.0, np.zeros(3)))
    data = mujoco.MjData(model)
    q, v, a = np.random.default_rng(axes).normal(size=(3, 10, axes))
    theirs = []
    for row in zip(q, v, a, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        theirs.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(inverse_dynamics(rig, q, v, a), theirs, rtol=1e-9, atol=1e-9)
    for body in rig.bodies:
        moments = np.linalg.eigvalsh(body.tensor)
        assert body.mass > 0.0 and moments[0] > 0.0 and moments[0] + moments[1] >= moments[2]


@pytest.mark.parametrize("joint", [0, 2, 4])
def test_a_bolted_joint_is_a_joint_at_zero(joint: int) -> None:
    rig = draw_arm(np.random.default_rng(9), 5)
    q, v, a = np.random.default_rng(joint).normal(size=(3, 10, 5))
    q[:, joint] = v[:, joint] = a[:, joint] = 0.0
    others = [i for i in range(5) if i != joint]
    whole = inverse_dynamics(rig, q, v, a)[:, others]
    fewer = inverse_dynamics(locked(rig, joint), *(x[:, others] for x in (q, v, a)))
    np.testing.assert_allclose(fewer, whole, atol=1e-9)


def test_repeats_repeat_and_turns_turn() -> None:
    t = np.arange(4000) / 100.0
    x = np.stack([rough(t, 1), rough(t, 2)], axis=1)
    habit = replace(repeated(4000, 4, 100.0), held=(1,))
    folded = habit.motion(x.copy())
    np.testing.assert_array_equal(folded[:1000], folded[3000:])
    assert np.abs(np.diff(folded[:, 0])).max() < 1.5 * np.abs(np.diff(x[:, 0])).max()
    assert np.ptp(folded[:, 1]) == 0.0
    for turns in (1.0, 100.0):
        path = turning_path(np.random.default_rng(2), t, turns)
        assert np.abs(np.diff(path)).sum() == pytest.approx(2.0 * np.pi * turns, rel=0.01)
        turned = Habit(turning=0, path=path).motion(x.copy())
        np.testing.assert_array_equal(turned[:, 0], path)


# visibility ----------------------------------------------------------------------------------------------------------


def test_visibility_in_coloured_noise_is_what_the_hand_computes() -> None:
    """A sine's power spread over the band, against the density at its frequency: white noise and φ = 0.98."""
    rate, band, amplitude, sigma, hertz = 100.0, 20.0, 0.3, 0.1, 4.0
    t = np.arange(6000) / rate
    effect = amplitude * np.sin(2.0 * np.pi * hertz * t)[:, None]
    nothing = np.zeros((len(t), 1, 1))
    grid = np.linspace(0.0, 20.0, 2001)
    white = np.full((len(grid), 1), sigma**2 / (0.5 * rate))
    red = sigma**2 * Colour("ar1", 0.98, 1.0).density(grid, rate)[:, None]
    at = np.cos(2.0 * np.pi * hertz / rate)
    density = sigma**2 * (1.0 - 0.98**2) / (1.0 - 2.0 * 0.98 * at + 0.98**2) / (0.5 * rate)
    for spectrum, there in ((white, white[0, 0]), (red, density)):
        by_hand = np.sqrt(0.5 * amplitude**2 / (band * there))
        assert size(effect, nothing, Spectrum(grid, spectrum), rate)[0] == pytest.approx(
            by_hand, rel=0.01
        )
    assert size(effect, 2.0 * effect[:, :, None], Spectrum(grid, red), rate)[0] < 1e-6
    slow = amplitude * np.sin(2.0 * np.pi * 0.2 * t)[:, None]
    assert (
        size(slow, nothing, Spectrum(grid, red), rate)[0]
        < 0.2 * size(effect, nothing, Spectrum(grid, red), rate)[0]
    )
    assert Spectrum(grid, white).floor()[0] == pytest.approx(sigma * np.sqrt(band / (0.5 * rate)))


def test_noise_itself_is_of_size_one() -> None:
    colour = Colour("ar1", 0.97, 1.0)
    x = 0.2 * colour.series(np.random.default_rng(0), (20_000, 2), 100.0)
    grid = np.linspace(0.0, 20.0, 2001)
    spectrum = Spectrum(grid, 0.04 * np.tile(colour.density(grid, 100.0)[:, None], 2))
    np.testing.assert_allclose(size(x, np.zeros((len(x), 2, 1)), spectrum, 100.0), 1.0, rtol=0.05)


# plans and cases -----------------------------------------------------------------------------------------------------


@cache
def small_case(idle: str = "unlogged") -> Case:
    hidden = (Hidden("cogging", "single", 0.3, 0.9),)
    return hide(
        DrivePlan(
            5,
            "drive-single",
            hidden,
            axes=2,
            level="drive",
            rate=100.0,
            seconds=2.0,
            arm=True,
            idle=idle,
        )
    )


def test_the_old_strata_draw_what_they_drew() -> None:
    for stratum in STRATA:
        if stratum not in DRIVE_STRATA:
            told = repr(sample(60, 771293, stratum)).encode()
            assert hashlib.sha256(told).hexdigest()[:12] == OLD_PLANS[stratum], stratum
    log = hide(Plan(3, "clean", axes=1, rate=250.0, seconds=1.0)).log
    assert sum(float(np.abs(values).sum()) for values in log.values()) == pytest.approx(
        561.0799554710202, rel=1e-6
    )


@pytest.mark.parametrize(
    ("idle", "kinds"), [("unlogged", ["revolute"] * 2), ("bolted", ["fixed", "revolute"])]
)
def test_an_unlogged_joint_stands_in_the_urdf_alone(
    idle: str, kinds: list[str], tmp_path: Path
) -> None:
    case = small_case(idle)
    files = write(case, tmp_path)
    told = yaml.safe_load(files.rig.read_text(encoding="utf-8"))
    (joint,) = case.truth["joints"]  # type: ignore[misc]
    assert len(told["motors"]) == kinds.count("revolute") and joint in told["motors"]
    root = ElementTree.parse(files.urdf).getroot()
    assert sorted(x.get("type") or "" for x in root.iter("joint")) == sorted(["fixed", *kinds])
    assert {name for name in case.log if name.startswith("tau_")} == {f"tau_{joint}"}
    cause = case.truth["causes"][0]  # type: ignore[index]
    assert cause["snr"][joint] > 0.0 and case.truth["stratum"] == "drive-single"
    assert case.oracle["rows"].max() < len(case.oracle["t"])
    assert len(case.perfect["t"]) == pytest.approx(200, abs=2)


def test_drives_logs_are_of_every_kind() -> None:
    plans = sample(240, 1, "drive-clean")
    assert all(isinstance(plan, DrivePlan) and not plan.hidden for plan in plans)
    drives = [plan for plan in plans if isinstance(plan, DrivePlan)]
    assert {plan.variant for plan in drives} == set(VARIANTS)
    assert {plan.axes for plan in drives} == set(range(1, 8))
    assert {plan.repeats for plan in drives} == {1, 4, 5}
    assert {plan.idle for plan in drives} == {"", "held", "unlogged", "bolted"}
    assert min(p.seconds for p in drives) == 5.0 and max(p.seconds for p in drives) > 480.0
    assert min(p.turns for p in drives if p.turns) < 3.0 and max(p.turns for p in drives) > 50.0


def test_no_delay_is_planted_where_channels_are_shifted() -> None:
    plans = [plan for stratum in DRIVE_STRATA for plan in sample(120, 2, stratum)]
    late = [plan for plan in plans if any(item.cause in ALIGNED for item in plan.hidden)]
    assert late and all(isinstance(plan, DrivePlan) and plan.aligned for plan in late)
    sensors = draw_drive_sensors(np.random.default_rng(0), RATE, True)
    assert (
        sensors.angle_late == 0.0
        and sensors.torque_late == pytest.approx(0.0)
        and sensors.torque_every == 1
    )
    delay = CATALOGUE["delay"](0, "fixed", 1e-3, 0.0)  # type: ignore[call-arg]
    assert clear_of_alignment(delay).parameters()["delay"] == pytest.approx(CLEAR_OF_IT)


def test_seeds_differ_from_plan_to_plan() -> None:
    seeds = sorted(plan.seed for stratum in DRIVE_STRATA for plan in sample(60, 3, stratum))
    assert all(a != b for a, b in pairwise(seeds))
