"""Every data fault is found by its own check and by no other; clean logs, dirty as real sensors are, show none.

- what is wrong is named, measured and mended where it is, and mended once;
- what only looks like a fault (a knock, a motor that is off, a counterbalance, a smooth torque) is none;
- noise in the regressor: instruments keep what least squares loses;
- measured logs of others have the faults that their authors state, and no others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from gimbal_pin.checks import CHECKS, Fault, check_log
from gimbal_pin.checks.harm import build_design
from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import compute_gravity, nominal
from gimbal_pin.log import Array, Log, read_log, write_log
from gimbal_pin.regression import Filtering, fit_weighted
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed
from tests.checks.corruption import CORRUPTIONS
from tests.command_line import Run, result
from tests.rigs import bundled

FILTER = Filtering()


@cache
def bench(name: str = "turret") -> tuple[Rig, Log]:
    """A rig on the bench for ten seconds, with one per cent of noise on the torque."""
    rig = bundled(name)
    model = nominal(rig)
    law = tune(model, bandwidth_hz=4.0, dt=2e-3).controller
    rng = np.random.default_rng(5)
    return rig, bench_run(model, law, rng=rng, seconds=10.0, encoder_bits=16.0)


def corrupted(log: Log, name: str, seed: int = 3, **size: Any) -> Log:
    """Return a log with a fault in it."""
    return CORRUPTIONS[name](log, np.random.default_rng(seed), **size)


def is_clean(name: str, rig: Rig, log: Log) -> bool:
    """Return whether one check finds nothing."""
    return CHECKS[name](rig, log, FILTER) is None


def find(name: str, rig: Rig, log: Log) -> tuple[Fault, dict[str, float], Log]:
    """Return the fault that one check finds, its figures, and the mended log."""
    found = CHECKS[name](rig, log, FILTER)
    assert found is not None
    figures = {parameter.name: parameter.value for parameter in found.fault.parameters}
    return found.fault, figures, found.repairs[-1] if found.repairs else log


# ---- the matrix ----

PLANTED: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in CORRUPTIONS),
    ("clock", {"jitter": 0.0, "holes": 1}),
    ("clock", {"jitter": 0.0, "stale": 0.15}),
    ("stuck-channel", {"channel": "q", "seconds": 0.5}),
    ("stuck-channel", {"channel": "v", "seconds": 0.0}),
    ("stuck-channel", {"channel": "tau", "seconds": 0.0}),
    ("outliers", {"channel": "q", "share": 0.0005, "size": 4.0}),
    ("outliers", {"channel": "v", "seconds": 0.5}),
    ("outliers", {"channel": "tau", "share": 0.0005, "size": 30.0}),
    ("filtered-velocity", {"corner": 5.0, "order": 2}),
    ("acceleration-noise", {"angle": 0.005, "rate": 0.3}),
]


@pytest.mark.parametrize(("planted", "size"), PLANTED)
def test_a_fault_is_found_by_its_own_check_alone_and_mended_once(
    planted: str, size: dict[str, Any]
) -> None:
    rig, log = bench()
    bad = corrupted(log, planted, **size)
    assert [name for name in CHECKS if not is_clean(name, rig, bad)] == [planted]
    found = check_log(rig, bad)
    assert [fault.cause for fault in found.faults] == [planted]
    assert (found.notes == ()) == found.faults[0].makes_physics_unreliable
    assert {one.cause for one in found.alterations} <= {planted}
    assert (found.log is bad) == (not found.alterations)
    assert check_log(rig, found.log).log is found.log


def few_lost(log: Log, rng: np.random.Generator) -> Log:
    """Two in a thousand samples lost, stamps off by ten microseconds."""
    t = log.t + 1e-5 * rng.uniform(-1, 1, len(log))
    return replace(log, t=t).part(np.sort(rng.permutation(len(log))[len(log) // 500 :]))


def smooth(x: Array, samples: float) -> Array:
    """Return columns smoothed off line, or by a drive that filters its current."""
    return np.asarray(gaussian_filter1d(x, samples, axis=0))


def coarse(log: Log) -> Array:
    """Steps of a smooth torque, which rests on each for long."""
    step = 0.15 * np.std(log.tau, axis=0)
    return np.asarray(step * np.round(smooth(np.asarray(log.tau), 4) / step))


def add(log: Log, noise: Array) -> Log:
    """Return a log with noise on its torque, in multiples of its deviation."""
    return replace(log, tau=log.tau + np.std(log.tau, axis=0) * noise)


SOUND: dict[str, Callable[[Log, np.random.Generator], Log]] = {
    "as recorded": lambda log, rng: log,
    "no rate": lambda log, rng: replace(log, v=None),
    "colour": lambda log, rng: add(log, 0.1 * smooth(rng.normal(size=log.q.shape), 10)),
    "biased, noisy rate": lambda log, rng: replace(
        log, v=log.v + 0.01 + 0.02 * rng.normal(size=log.q.shape)
    ),
    "some dirt in the clock": few_lost,
    "smooth torque": lambda log, rng: replace(log, tau=smooth(log.tau, 15)),
    "smooth, no reference": lambda log, rng: replace(log, tau=smooth(log.tau, 15), q_ref=None),
    "coarse torque": lambda log, rng: replace(log, tau=coarse(log)),
    "kicks": lambda log, rng: add(log, np.gradient(np.floor(log.q / 0.1), axis=0)),
    "bursts": lambda log, rng: add(
        log, 3 * np.cos(np.pi * log.t / log.dt)[:, None] * (np.sin(4 * log.t) > 0.7)[:, None]
    ),
    "heavy tails": lambda log, rng: add(log, 0.05 * rng.standard_t(3, log.q.shape)),
    "two samples": lambda log, rng: log.part(slice(0, 2)),
    "half a second": lambda log, rng: log.part(slice(0, 250)),
}


@pytest.mark.parametrize(("name", "dirt"), list(zip(cycle(["turret", "thesis"]), SOUND)))
def test_sound_logs_are_left_as_they_are_however_dirty_the_sensors(name: str, dirt: str) -> None:
    rig, log = bench(name)
    given = SOUND[dirt](log, np.random.default_rng(3))
    found = check_log(rig, given)
    assert found.log is given
    assert [fault.cause for fault in found.faults if not fault.slight] == []


def test_a_rig_that_never_moved_has_no_fault() -> None:
    rig, log = bench()
    noise = 1e-3 * np.random.default_rng(0).standard_normal((2, *log.q.shape))
    assert check_log(rig, Log("still", log.joints, log.t, 0 * log.q, *noise)).is_reliable


def test_a_knock_is_not_cut_out() -> None:
    """A gap that closes, or a hand that knocks the rig, makes a jump that dies away, not noise."""
    rig, log = bench()
    dying = np.exp(-(log.t[:, None] % 2.9) / 0.006)
    assert len(check_log(rig, add(log, 8.0 * dying)).log) == len(log)


def test_the_order_of_a_logs_joints_does_not_matter() -> None:
    rig, log = bench()
    bad = corrupted(log, "outliers")
    turned = {name: x[:, ::-1] for name, x in bad.channels.items()}
    one = check_log(rig, bad)
    other = check_log(rig, replace(bad, joints=bad.joints[::-1], **turned))
    assert (one.alterations, one.faults) == (other.alterations, other.faults)
    np.testing.assert_array_equal(one.log.q, other.log.q)


# ---- what the checks measure, and what they mend ----


def test_spikes_are_bridged_and_what_is_altered_is_what_differs() -> None:
    rig, log = bench()
    bad = corrupted(log, "outliers", channel="q", share=0.001)
    found = check_log(rig, bad)
    hit = bad.q != log.q
    np.testing.assert_array_equal(found.log.q != bad.q, hit)
    assert np.abs(found.log.q - log.q).max() < 0.01 * np.abs(bad.q - log.q).max()
    (one,) = found.alterations
    assert (one.kind, one.samples, one.unit) == ("changed", hit.sum(), "rad")
    assert hit[:, rig.joints.index(one.channel[2:])].any()
    assert one.size == pytest.approx(np.abs(bad.q - found.log.q).max())
    assert [one.first, one.last] == log.t[hit.any(axis=1)][[0, -1]].tolist()


def test_of_a_long_log_what_an_excerpt_shows_is_mended_everywhere() -> None:
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=300.0, torque_noise=0.01, dt=5e-3)
    found = check_log(rig, corrupted(log, "outliers", channel="q", share=2e-3))
    assert np.abs(found.log.q - log.q).max() < 0.05 * np.std(log.q)
    assert check_log(rig, log).log is log


def test_verbs_list_what_they_alter(run: Run, tmp_path: Path) -> None:
    rig, log = bench()
    path = tmp_path / "spikes.csv"
    write_log(corrupted(log, "outliers", channel="q", share=0.001), path)
    (shown,) = result(run, "inspect", path, "--rig", rig.name)["files"][0]["altered"]
    (fitted,) = result(run, "identify", rig.name, path)["altered"]
    assert (fitted["cause"], fitted["kind"], fitted["log"]) == ("outliers", "changed", str(path))
    assert shown.items() <= fitted.items()


@pytest.mark.parametrize(
    ("cause", "size"),
    [
        ("stuck-channel", {"channel": "q", "seconds": 1.0}),
        ("stuck-channel", {"channel": "v", "seconds": 1.0}),
        ("stuck-channel", {"channel": "tau", "seconds": 1.0}),
        ("outliers", {"channel": "v", "seconds": 1.0}),
        ("clock", {"jitter": 0.0, "stale": 0.04}),
    ],
)
def test_stuck_garbled_and_repeated_rows_are_cut_and_nothing_else(
    cause: str, size: dict[str, Any]
) -> None:
    rig, log = bench()
    bad = corrupted(log, cause, **size)
    _, _, mended = find(cause, rig, bad)
    pairs = ((bad.channels[name], x) for name, x in log.channels.items())
    touched = log.t[np.any([np.any(one != other, axis=1) for one, other in pairs], axis=0)]
    assert np.mean(np.isin(touched, mended.t)) < 0.05
    assert len(log) - len(mended) < len(touched) + 0.3 / log.dt


def test_false_stamps_are_evened_and_true_ones_are_left() -> None:
    rig, log = bench()
    jittered = corrupted(log, "clock", jitter=0.3)
    _, _, mended = find("clock", rig, jittered)
    assert np.std(mended.t - log.t) < 0.3 * np.std(jittered.t - log.t)
    channels = (
        np.column_stack([np.interp(jittered.t, log.t, column) for column in x.T])
        for x in (log.q, log.v, log.tau)
    )
    sampled = Log("sampled at odd times", log.joints, jittered.t, *channels)
    fault, _, mended = find("clock", rig, sampled)
    assert mended is sampled
    assert not fault.makes_physics_unreliable


def test_a_servos_law_harms_within_no_motors_limit_and_is_clipped_beyond() -> None:
    rig, log = bench("thesis")
    commanded = corrupted(log, "commanded-torque")
    fault, _, mended = find("commanded-torque", rig, commanded)
    assert not fault.makes_physics_unreliable
    assert mended is commanded
    size = 1.5 * rig.tau_max / np.abs(commanded.tau).max(axis=0)
    fault, _, mended = find("commanded-torque", rig, replace(commanded, tau=commanded.tau * size))
    assert fault.makes_physics_unreliable
    assert np.all(np.abs(mended.tau) <= rig.tau_max)


@pytest.mark.parametrize(
    ("corner", "order", "noise", "within"),
    [(2.0, 1, 0.0, 0.15), (4.0, 2, 0.0, 0.15), (4.0, 1, 0.01, 0.3)],
)
def test_the_corner_of_a_filtered_rate(
    corner: float, order: int, noise: float, within: float
) -> None:
    """Also where the rate has noise of its own, which hides the recursion: the slow motion's lag shows it."""
    rig, log = bench()
    bad = corrupted(log, "filtered-velocity", corner=corner, order=order)
    own = noise * np.random.default_rng(0).standard_normal(log.q.shape)
    _, figures, mended = find("filtered-velocity", rig, replace(bad, v=bad.v + own))
    assert mended.v is None
    assert figures["corner"] == pytest.approx(corner, rel=within)
    assert figures["order"] == order


@pytest.mark.parametrize("is_coarse", [False, True])
def test_a_late_rate_is_not_a_filtered_one_and_is_moved_to_its_time(is_coarse: bool) -> None:
    """By three samples; or a servo's: the mean of the last 40 ms in steps, over rows that repeat the row before."""
    rig, log = bench()
    late = replace(log.part(slice(3, None)), v=np.asarray(log.v)[:-3])
    delay = 3 * log.dt
    if is_coarse:
        log = prescribed(nominal(rig), seconds=6.0, dt=5e-3)
        v = 0.05 * np.round((log.q[8:] - log.q[:-8]) / 0.04 / 0.05)
        v[1::2] = v[:-1:2]
        late = replace(log.part(slice(8, None)), v=v)
        delay = 0.0225
    fault, figures, mended = find("filtered-velocity", rig, late)
    assert "low-pass" not in fault.sentence + fault.next_experiment
    assert figures["delay"] == pytest.approx(delay, rel=0.1)
    assert is_clean("filtered-velocity", rig, mended)


# ---- what is no fault of the sensors ----


def test_a_motor_that_is_off_is_not_stuck() -> None:
    """A torque that rests with the joint is a measurement, if the model agrees."""
    rig = bundled("turret")
    t = np.arange(-5.0, 5.0, 2e-3)
    swing = 0.5 * np.sin(2.0 * t) * np.clip(np.abs(t) - 1.0, 0.0, 1.0)
    q = np.column_stack([swing, swing])
    v = np.gradient(q, t, axis=0)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(q.shape)
    tau = nominal(rig).inverse_dynamics(q, v, np.gradient(v, t, axis=0)) + noise
    tau[np.abs(t) < 0.9] = tau[len(t) // 2]
    assert is_clean("stuck-channel", rig, Log("rests", rig.joints, t, q, v, tau))


def test_a_coarse_rate_of_an_even_motion_is_not_stuck() -> None:
    """It rests on a step that is off by more than half of one, as long as the joint turns evenly."""
    rig = bundled("turret")
    t = np.arange(0.0, 40.0, 0.01)
    is_even = t < 20.0
    swing = 0.2 * (1 - np.cos(1.5 * (t - 20.0))) * ~is_even
    ramps = gaussian_filter1d(0.12 * np.abs(t % 10.0 - 5.0), 20, mode="nearest")
    q = np.column_stack([ramps + swing, 0.5 * np.sin(1.1 * t)])
    v = np.gradient(q, t, axis=0)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(q.shape)
    tau = nominal(rig).inverse_dynamics(q, v, np.gradient(v, t, axis=0)) + noise
    off = 0.04 * np.sign(v[:, 0]) * is_even
    v[:, 0] = 0.03 * np.round((v[:, 0] + off) / 0.03)
    q = 7.67e-4 * np.round(q / 7.67e-4)
    assert is_clean("stuck-channel", rig, Log("coarse", rig.joints, t, q, v, tau))


@pytest.mark.parametrize(("bits", "jitter"), [(19, 0.05), (16, 0.05), (19, 0.02)])
def test_stamps_that_jitter_are_no_noise_of_the_encoders(bits: int, jitter: float) -> None:
    """At 100 Hz 5 % of a period are worth 9 bits of an encoder of 19; the angles are true and the stamps are not."""
    rig = bundled("turret")
    step = 2 * np.pi / 2**bits
    log = prescribed(nominal(rig), seconds=20.0, torque_noise=0.01, dt=0.01)
    late = jitter * log.dt * np.random.default_rng(1).standard_normal(len(log))
    bad = replace(log, t=log.t + late, q=step * np.round(log.q / step), v=None)
    assert is_clean("acceleration-noise", rig, bad)


# ---- noise in the regressor ----


@pytest.mark.parametrize(("has_reference", "gain"), [(True, 0.6), (False, 1.0)])
def test_instruments_keep_what_least_squares_loses(has_reference: bool, gain: float) -> None:
    """White noise on the angles: least squares is wrong by many of its deviations, the answer by few of its own.

    Without a reference each half of the samples is the other's instrument, as noisy as what it stands for: such an
    answer scatters more, and need only be nearer over several draws of the noise.
    """
    rig, log = bench()
    known = replace(log, v=None, q_ref=log.q_ref if has_reference else None)
    made = build_design(rig, log, FILTER)
    clean = fit_weighted(list(made))
    A = np.concatenate([block.A for block in made])
    shares = []
    for seed in range(3):
        noisy = corrupted(known, "acceleration-noise", seed=seed, angle=0.014)
        fault, _, _ = find("acceleration-noise", rig, noisy)
        assert [parameter.name for parameter in fault.answer] == list(made.names)
        answer, std = np.transpose([(parameter.value, parameter.std) for parameter in fault.answer])
        plain = fit_weighted(list(build_design(rig, noisy, FILTER)))
        wrong = plain.theta - clean.theta
        right = answer - clean.theta
        assert np.abs(right / np.hypot(std, clean.std)).max() < 3
        assert np.abs(wrong / np.hypot(plain.std, clean.std)).max() > 3
        shares.append(np.linalg.norm(A @ right) / np.linalg.norm(A @ wrong))
    assert np.median(shares) < gain


# ---- formulas in place of a torque ----


@pytest.mark.parametrize(("name", "speed"), [("turret", 1.0), ("thesis", 0.1), ("drone", 0.1)])
def test_a_controllers_formula_is_told_from_a_passive_plants_torque(
    name: str, speed: float
) -> None:
    """A speed loop's, or a hand's beside a torque that cancels gravity; slow or fast, with springs and cogging."""
    rig = bundled(name)
    motion = fourier(rig, 4, 20.0 * speed, 2e-3 * speed)
    q = motion.q
    v = motion.v * speed
    a = motion.a * speed**2
    noise = np.random.default_rng(3).standard_normal(q.shape)
    log = Log("plant", rig.joints, motion.t / speed, q, v, 0.0 * q)

    def is_plants(tau: Array) -> bool:
        return is_clean("controller-formula", rig, replace(log, tau=tau))

    tau = nominal(rig).inverse_dynamics(q, v, a)
    size = np.sqrt(np.mean(tau**2, axis=0))
    tau += size * (0.3 + 0.5 * q + 0.01 * noise)
    assert is_plants(tau)
    for delay in (0, 2, 5):
        speed_loop = corrupted(replace(log, tau=tau), "controller-formula", delay=delay)
        fault, figures, _ = find("controller-formula", rig, speed_loop)
        assert figures["delay"] == pytest.approx(delay * log.dt)
    weighed = compute_gravity(rig, q)
    size = np.maximum(np.sqrt(np.mean(weighed**2, axis=0)), 0.01)
    hand = replace(log, tau=weighed + size * (0.2 * q + 1e-4 * noise))
    fault, figures, _ = find("controller-formula", rig, hand)
    assert fault.makes_physics_unreliable
    assert figures["left"] < 1e-3
    slippery = nominal(replace(rig, friction=0.01 * rig.friction)).inverse_dynamics(q, v, a)
    assert is_plants(slippery + size * (2.0 * q + np.sin(12 * q) + 1e-4 * noise))


def test_one_sine_in_which_any_delay_fits_is_no_formula() -> None:
    """There the acceleration is a multiple of the angle."""
    rig = bundled("turret")
    t = np.arange(0.0, 20.0, 2e-3)
    phase = np.outer(t, [2.5, 4.4])
    q = 0.5 * np.sin(phase)
    v = phase / t[:, None].clip(1e-9) * np.cos(phase) / 2
    noise = np.random.default_rng(7).standard_normal(q.shape)
    tau = nominal(rig).inverse_dynamics(q, v, np.gradient(v, t, axis=0))
    log = add(Log("sine", rig.joints, t, q, v, tau), 0.3 + 0.5 * q + 0.01 * noise)
    assert is_clean("controller-formula", rig, log)


@pytest.mark.parametrize(("name", "stiffness"), [("turret", 0.0), ("thesis", 3.0), ("drone", -3.0)])
def test_a_counterbalance_is_no_fault(name: str, stiffness: float) -> None:
    """Twice the weight, by a constant force or a spring; the URDF's inertia is three times the true one."""
    rig = bundled(name)
    slippery = nominal(replace(rig, friction=0.05 * rig.friction))
    log = prescribed(slippery, 6, torque_noise=0.01, dt=2e-3)
    size = np.sqrt(np.mean(np.asarray(log.tau) ** 2, axis=0))
    balanced = replace(log, tau=log.tau + size * (2.0 + stiffness * log.q))
    for given in (rig, rig.with_phi(3.0 * rig.phi)):
        assert not check_log(given, balanced).faults


# ---- real data ----

DATA = Path(__file__).parents[3] / "shared" / "data"
PENDULUM = "t=time q_shoulder=position dq_shoulder=velocity tau_shoulder=torque"
MOTOR = "t=Time q_motor=Position dq_motor=Velocity tau_motor=Iq*0.025"
NOISE = "acceleration-noise"
FORMULA = "controller-formula"


@pytest.mark.parametrize(
    ("urdf", "file", "columns", "causes", "figures"),
    [
        (
            "dfki_simple_pendulum/pendulum",
            "system_identification.csv",
            PENDULUM,
            [NOISE],
            {"arm.Iyy": (0.144, 0.2), "arm.mz": (-0.288, 0.2)},
        ),
        ("dfki_simple_pendulum/pendulum", "gravity_compensation.csv.gz", PENDULUM, [FORMULA], {}),
        (
            "laas_anti_cogging/rotor",
            "speed_test1_off.csv",
            MOTOR,
            ["clock", FORMULA],
            {"gain": (0.025 * 0.087, 0.03), "delay": (0.002, 0.05)},
        ),
        ("ur10_unisa/ur10", "ur10_exciting.db3", "", [], {}),
    ],
)
def test_a_measured_logs_faults_are_those_that_its_authors_state(
    urdf: str,
    file: str,
    columns: str,
    causes: list[str],
    figures: dict[str, tuple[float, float]],
) -> None:
    """The pendulum's answer is the physical arm, the speed loop's gain and delay are its drive's.

    No motor moves what only has its weight cancelled; an arm's torque that is smoothed is no command.
    """
    place = DATA / f"{urdf}.urdf"
    if not place.is_file():
        pytest.skip(f"../shared/data/{urdf}.urdf is not there")
    rig = Rig.load(place)
    log = read_log(place.parent / file, rig, columns.split())
    found = check_log(rig, log.part(np.flatnonzero(log.t < log.t[0] + 12.0)))
    assert [fault.cause for fault in found.faults if not fault.slight] == causes
    assert found.is_usable == found.is_reliable == (not file.startswith("gravity"))
    told = {p.name: p.value for fault in found.faults for p in (*fault.parameters, *fault.answer)}
    for name, (value, within) in figures.items():
        assert told[name] == pytest.approx(value, rel=within)
