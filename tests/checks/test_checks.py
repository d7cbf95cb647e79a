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
from scipy.signal import lfilter

from gimbal_pin.checks import CHECKS, CheckedLog, Fault, check_log
from gimbal_pin.checks.harm import build_design
from gimbal_pin.checks.record import Examined
from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import compute_gravity, nominal
from gimbal_pin.log import Array, Log, read_log, signals, write_log
from gimbal_pin.regression import Filtering, fit_weighted
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed
from tests.checks.corruption import CORRUPTIONS
from tests.command_line import Run, result
from tests.rigs import bundled

DATA = Path(__file__).parents[3] / "shared" / "data"
BENCH = {"turret": (14.0, 2e-3), "thesis": (16.0, 1e-3), "handheld": (12.0, 2e-3)}
"""Bits of the encoders, and sampling interval, s."""
FILTER = Filtering()


@cache
def bench(name: str) -> tuple[Rig, Log]:
    """A rig on the bench for twenty seconds, with one per cent of noise on the torque."""
    rig = bundled(name)
    (encoder, dt) = BENCH[name]
    model = nominal(rig)
    rng = np.random.default_rng(5)
    law = tune(model, bandwidth_hz=4.0, dt=dt).controller
    return rig, bench_run(model, law, rng=rng, seconds=20.0, encoder_bits=encoder)


def corrupted(log: Log, name: str, seed: int = 1, **size: Any) -> Log:
    """Return a log with a fault in it."""
    return CORRUPTIONS[name](log, np.random.default_rng(seed), **size)


def examine(name: str, rig: Rig, log: Log) -> Examined | None:
    """Return what one check finds."""
    return CHECKS[name](rig, log, FILTER)


def find(name: str, rig: Rig, log: Log) -> tuple[Fault, dict[str, float], Log]:
    """Return the fault that one check finds, its figures, and the mended log."""
    found = examine(name, rig, log)
    assert found is not None
    figures = {parameter.name: parameter.value for parameter in found.fault.parameters}
    return found.fault, figures, found.repairs[-1] if found.repairs else log


# ---- the matrix ----


@pytest.mark.parametrize("planted", CORRUPTIONS)
def test_a_fault_is_found_by_its_own_check_alone(planted: str) -> None:
    rig, log = bench("turret")
    bad = corrupted(log, planted)
    assert [name for name, check in CHECKS.items() if check(rig, bad, FILTER) is not None] == [
        planted
    ]


SIZES: list[tuple[str, dict[str, Any]]] = [
    ("commanded-torque", {}),
    ("clock", {"jitter": 0.0, "holes": 6}),
    ("clock", {"jitter": 0.0, "stale": 0.15}),
    ("stuck-channel", {"channel": "q", "seconds": 0.5}),
    ("stuck-channel", {"channel": "v", "rail": 0.85}),
    ("stuck-channel", {"channel": "tau", "rail": 0.85}),
    ("outliers", {"channel": "q", "share": 0.0005, "size": 4.0}),
    ("outliers", {"channel": "v", "seconds": 1.0}),
    ("outliers", {"channel": "tau", "share": 0.0005, "size": 30.0}),
    ("filtered-velocity", {"corner": 5.0, "order": 2}),
    ("acceleration-noise", {"angle": 0.005, "rate": 0.3}),
]


@pytest.mark.parametrize(
    ("planted", "size"), SIZES, ids=lambda x: x if isinstance(x, str) else "-".join(x)
)
def test_faults_of_other_kinds_and_sizes_are_named_and_mended_once(
    planted: str, size: dict[str, Any]
) -> None:
    rig, log = bench("thesis")
    bad = corrupted(log, planted, seed=3, **size)
    found = check_log(rig, bad)
    assert [fault.cause for fault in found.faults] == [planted]
    assert (found.notes == ()) == found.faults[0].makes_physics_unreliable
    assert {one.cause for one in found.alterations} <= {planted}
    assert (found.log is bad) == (not found.alterations)
    again = check_log(rig, found.log)
    assert again.log is found.log
    assert not again.alterations


@pytest.mark.parametrize("name", BENCH)
def test_a_clean_log_is_returned_as_it_is(name: str) -> None:
    rig, log = bench(name)
    found = check_log(rig, log)
    assert found.log is log and not found.alterations


def test_what_is_altered_is_what_differs() -> None:
    rig, log = bench("turret")
    bad = corrupted(log, "outliers", channel="q", share=0.001)
    spiked = check_log(rig, bad)
    hit = bad.q != spiked.log.q
    (j,) = np.flatnonzero(hit.any(axis=0))
    (one,) = spiked.alterations
    assert (one.kind, one.channel) == ("changed", f"q_{rig.joints[j]}")
    assert (one.samples, one.unit) == (hit.sum(), "rad")
    assert one.size == pytest.approx(np.abs(bad.q - spiked.log.q).max())
    assert {one.first, one.last} <= {*log.t}
    slow = check_log(rig, corrupted(log, "filtered-velocity"))
    assert slow.log.v is None
    left_out = [(one.kind, one.channel) for one in slow.alterations]
    assert left_out == [("channel-left-out", f"dq_{joint}") for joint in rig.joints]
    bad = corrupted(log, "clock", jitter=0.0, stale=0.2)
    stale = check_log(rig, bad)
    (one,) = stale.alterations
    assert (one.kind, one.samples) == ("rows-left-out", len(bad) - len(stale.log))


def test_verbs_list_what_they_alter(run: Run, tmp_path: Path) -> None:
    rig, log = bench("turret")
    path = tmp_path / "spikes.csv"
    write_log(corrupted(log, "outliers", channel="q", share=0.001), path)
    (shown,) = result(run, "inspect", path, "--rig", rig.name)["files"][0]["altered"]
    (fitted,) = result(run, "identify", rig.name, path)["altered"]
    assert (fitted["cause"], fitted["kind"], fitted["log"]) == ("outliers", "changed", str(path))
    assert shown.items() <= fitted.items()


def test_the_order_of_a_logs_joints_does_not_matter() -> None:
    rig, log = bench("turret")
    bad = corrupted(log, "outliers")
    turned = {name: x[:, ::-1] for name, x in bad.channels.items()}
    one = check_log(rig, bad)
    other = check_log(rig, replace(bad, joints=bad.joints[::-1], **turned))
    assert (one.alterations, one.faults) == (other.alterations, other.faults)
    np.testing.assert_array_equal(one.log.q, other.log.q)


def test_of_a_long_log_what_an_excerpt_shows_is_mended_everywhere() -> None:
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=300.0, torque_noise=0.01, dt=5e-3)
    found = check_log(rig, corrupted(log, "outliers", channel="q", share=2e-3))
    assert np.abs(found.log.q - log.q).max() < 0.05 * np.std(log.q)
    assert check_log(rig, log).log is log


def coloured(log: Log, size: float, corner: float, rng: np.random.Generator) -> Array:
    """Return first-order noise on every torque, as a share of its rms."""
    keep = np.exp(-2 * np.pi * corner * log.dt)
    noise = rng.standard_normal(log.q.shape)
    slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], noise, axis=0)
    return size * np.sqrt(np.mean(np.asarray(log.tau) ** 2, axis=0)) * slow


def few_lost(log: Log, rng: np.random.Generator) -> Log:
    """Two in a thousand samples lost, stamps off by ten microseconds."""
    kept = np.sort(rng.permutation(len(log))[: round(0.998 * len(log))])
    return replace(log.part(kept), t=log.t[kept] + 1e-5 * rng.uniform(-1, 1, len(kept)))


DIRTY: dict[str, Callable[[Log, np.random.Generator], Log]] = {
    "as recorded": lambda log, rng: log,
    "no rate": lambda log, rng: replace(log, v=None),
    "slow colour": lambda log, rng: replace(log, tau=log.tau + coloured(log, 0.015, 3.0, rng)),
    "fast colour, 250 Hz": lambda log, rng: replace(
        log, tau=log.tau + coloured(log, 0.015, 30.0, rng)
    ).part(slice(None, None, 4)),
    "biased, noisy rate": lambda log, rng: replace(
        log, v=log.v + 0.01 + 0.02 * rng.standard_normal(log.q.shape)
    ),
    "some dirt in the clock": few_lost,
}


@pytest.mark.parametrize(("name", "dirt"), list(zip(cycle(reversed(BENCH)), DIRTY)))
def test_clean_logs_are_reliable_however_dirty_the_sensors(name: str, dirt: str) -> None:
    rig, log = bench(name)
    found = check_log(rig, DIRTY[dirt](log, np.random.default_rng(3)))
    assert found.is_reliable, [fault.sentence for fault in found.faults]
    assert [fault.cause for fault in found.faults] in ([], ["acceleration-noise"])


@pytest.mark.parametrize("name", BENCH)
def test_a_servos_law_harms_within_no_motors_limit_and_is_clipped_beyond(name: str) -> None:
    rig, log = bench(name)
    commanded = corrupted(log, "commanded-torque")
    fault, _, mended = find("commanded-torque", rig, commanded)
    assert not fault.makes_physics_unreliable
    assert mended is commanded
    size = 1.5 * rig.tau_max / np.abs(commanded.tau).max(axis=0)
    beyond = replace(commanded, tau=commanded.tau * size)
    fault, _, mended = find("commanded-torque", rig, beyond)
    assert fault.makes_physics_unreliable
    assert np.all(np.abs(mended.tau) <= rig.tau_max)


@pytest.mark.parametrize(("name", "corner"), [("turret", 2.0), ("thesis", 5.0), ("handheld", 20.0)])
def test_a_torque_that_was_smoothed_off_line_is_not_commanded(name: str, corner: float) -> None:
    rig, log = bench(name)
    tau = signals.zero_phase(np.asarray(log.tau), signals.lowpass(corner, 1.0 / log.dt))
    for q_ref in (log.q_ref, None):
        assert not check_log(rig, replace(log, tau=tau, q_ref=q_ref)).faults


# ---- what the checks measure, and what they mend ----


@pytest.mark.parametrize(
    ("corner", "order", "noise", "within"),
    [(2.0, 1, 0.0, 0.15), (5.0, 1, 0.0, 0.15), (4.0, 2, 0.0, 0.15), (4.0, 1, 0.01, 0.3)],
)
def test_the_corner_of_a_filtered_rate(
    corner: float, order: int, noise: float, within: float
) -> None:
    """Also where the rate has noise of its own, which hides the recursion: the slow motion's lag shows it."""
    rig, log = bench("turret" if noise else "thesis")
    bad = corrupted(log, "filtered-velocity", corner=corner, order=order)
    own = noise * np.random.default_rng(0).standard_normal(log.q.shape)
    _, figures, mended = find("filtered-velocity", rig, replace(bad, v=bad.v + own))
    assert mended.v is None
    assert figures["corner"] == pytest.approx(corner, rel=within)
    assert figures["order"] == order


def test_a_delayed_rate_is_not_a_filtered_one_and_is_moved_to_its_time() -> None:
    rig, log = bench("turret")
    late = replace(log.part(slice(3, None)), v=np.asarray(log.v)[:-3])
    fault, figures, mended = find("filtered-velocity", rig, late)
    assert "low-pass" not in fault.sentence
    assert figures["delay"] == pytest.approx(3 * log.dt, rel=0.05)
    assert "corner" not in figures
    assert mended.v is not None
    assert examine("filtered-velocity", rig, mended) is None


def test_a_coarse_rate_that_repeats_itself_is_late_and_behind_no_low_pass() -> None:
    """A servo's rate: the mean of the last 40 ms in steps, over rows that repeat the row before."""
    rig = bundled("turret")
    log = prescribed(nominal(rig), seconds=6.0, dt=5e-3)
    v = 0.05 * np.round((log.q[8:] - log.q[:-8]) / 0.04 / 0.05)
    v[1::2] = v[:-1:2]
    fault, figures, _ = find("filtered-velocity", rig, replace(log.part(slice(8, None)), v=v))
    assert "low-pass" not in fault.sentence + fault.next_experiment
    assert figures["delay"] == pytest.approx(0.0225, abs=0.003)


def test_false_stamps_are_evened_and_true_ones_are_left() -> None:
    rig, log = bench("turret")
    jittered = corrupted(log, "clock", jitter=0.3)
    _, _, mended = find("clock", rig, jittered)
    assert np.std(mended.t - log.t) < 0.3 * np.std(jittered.t - log.t)
    late = np.clip(0.3e-3 * np.random.default_rng(1).standard_normal(len(log)), -0.49e-3, 0.49e-3)
    channels = (
        np.column_stack([np.interp(log.t + late, log.t, column) for column in x.T])
        for x in (log.q, log.v, log.tau)
    )
    sampled = Log("sampled at odd times", log.joints, log.t + late, *channels)
    fault, _, mended = find("clock", rig, sampled)
    assert mended is sampled
    assert not fault.makes_physics_unreliable


def test_repeated_rows_are_left_out() -> None:
    rig, log = bench("turret")
    stale = corrupted(log, "clock", jitter=0.0, stale=0.2)
    _, figures, mended = find("clock", rig, stale)
    repeats = np.all(np.diff(np.asarray(stale.tau), axis=0) == 0, axis=1)
    assert figures["stale"] == pytest.approx(0.2, abs=0.06)
    assert len(log) - len(mended) == pytest.approx(repeats.sum(), rel=0.02)


@pytest.mark.parametrize(
    ("cause", "channel", "seconds", "left"),
    [
        ("stuck-channel", "q", 1.0, 0.0),
        ("stuck-channel", "v", 1.0, 0.0),
        ("stuck-channel", "tau", 1.0, 0.0),
        ("outliers", "v", 1.5, 0.05),
    ],
)
def test_stuck_and_garbled_rows_are_cut_and_nothing_else(
    cause: str, channel: str, seconds: float, left: float
) -> None:
    rig, log = bench("turret")
    bad = corrupted(log, cause, seed=2, channel=channel, seconds=seconds)
    fault, _, mended = find(cause, rig, bad)
    touched = log.t[np.any(getattr(bad, channel) != getattr(log, channel), axis=1)]
    assert np.mean(np.isin(touched, mended.t)) <= left
    assert len(log) - len(mended) < len(touched) + 0.3 / log.dt
    assert fault.makes_physics_unreliable


def test_spikes_are_bridged() -> None:
    rig, log = bench("turret")
    bad = corrupted(log, "outliers", channel="q", share=0.001)
    fault, figures, mended = find("outliers", rig, bad)
    hit = np.any(bad.q != log.q, axis=1)
    assert fault.makes_physics_unreliable
    assert figures["spikes"] == hit.sum()
    assert np.abs(mended.q - log.q)[hit].max() < 0.01 * np.abs(bad.q - log.q)[hit].max()
    np.testing.assert_array_equal(mended.q[~hit], log.q[~hit])


# ---- what is no fault ----


def test_a_smooth_torque_in_coarse_steps_is_not_stuck() -> None:
    """A drive that filters its current and reports it in steps rests on each for long."""
    rig, log = bench("turret")
    smooth = gaussian_filter1d(np.asarray(log.tau), 0.008 / log.dt, axis=0)
    for share in (0.05, 0.15):
        step = share * np.std(smooth, axis=0)
        coarse = replace(log, tau=step * np.round(smooth / step))
        assert examine("stuck-channel", rig, coarse) is None


def test_a_motor_that_is_off_is_not_stuck() -> None:
    """A torque that rests with the joint is a measurement, if the model agrees."""
    rig, _ = bench("turret")
    t = np.arange(0.0, 20.0, 1e-3)
    envelope = np.clip(np.abs(t - 10.0) - 2.0, 0.0, 1.0)
    q = np.repeat((0.5 * np.sin(2.0 * t) * envelope)[:, None], rig.n, axis=1)
    v = np.gradient(q, 1e-3, axis=0)
    tau = nominal(rig).inverse(q, v, np.gradient(v, 1e-3, axis=0))
    tau += 1e-3 * np.random.default_rng(0).standard_normal(q.shape)
    still = np.abs(t - 10.0) < 1.9
    tau[still] = tau[np.argmax(still)]
    assert examine("stuck-channel", rig, Log("rests", rig.joints, t, q, v, tau)) is None


def test_a_knock_is_not_cut_out() -> None:
    """A gap that closes, or a hand that knocks the rig, makes a jump that dies away, not noise."""
    rig, log = bench("turret")
    tau = np.array(log.tau)
    for k in np.random.default_rng(0).integers(500, len(log) - 500, 3):
        tau[k : k + 100] += 8.0 * np.std(tau, axis=0) * np.exp(-np.arange(100) / 3.0)[:, None]
    knocked = replace(log, tau=tau)
    found = examine("outliers", rig, knocked)
    assert found is None or find("outliers", rig, knocked)[1]["garbage"] == 0.0


@pytest.mark.parametrize("name", ["thesis", "handheld"])
def test_a_drive_that_chatters_has_no_outliers(name: str) -> None:
    """Kicks at encoder steps, bursts that change sign with every sample, and noise of heavy tails."""
    rig, log = bench(name)
    rng = np.random.default_rng(2)
    length = round(0.2 / log.dt)
    bursts = np.zeros(log.q.shape)
    for begin in rng.integers(0, len(log) - length, 15):
        burst = (-1.0) ** np.arange(length) * np.hanning(length)
        bursts[begin : begin + length] += 3.0 * burst[:, None]
    kicks = np.diff(np.floor(log.q / 0.1), axis=0, prepend=np.floor(log.q[:1] / 0.1))
    for chatter in (kicks, bursts, 0.05 * rng.standard_t(3, log.q.shape)):
        tau = log.tau + np.std(log.tau, axis=0) * chatter
        assert examine("outliers", rig, replace(log, tau=tau)) is None


# ---- noise in the regressor ----


@pytest.mark.parametrize(("reference", "seeds", "gain"), [(True, 1, 0.6), (False, 3, 1.0)])
def test_instruments_keep_what_least_squares_loses(
    reference: bool, seeds: int, gain: float
) -> None:
    """White noise on the angles: least squares is wrong by many of its deviations, the answer by few of its own.

    Without a reference each half of the samples is the other's instrument, as noisy as what it stands for: such an
    answer scatters more, and need only be nearer over several draws of the noise.
    """
    rig, log = bench("thesis")
    known = replace(log, v=None, q_ref=log.q_ref if reference else None)
    made = build_design(rig, log, FILTER)
    clean = fit_weighted(list(made))
    A = np.concatenate([block.A for block in made])
    errors = []
    for seed in range(seeds):
        noisy = corrupted(known, "acceleration-noise", seed=seed, angle=0.01)
        fault, _, _ = find("acceleration-noise", rig, noisy)
        plain = fit_weighted(list(build_design(rig, noisy, FILTER)))
        assert fault.makes_physics_unreliable
        assert [parameter.name for parameter in fault.answer] == list(made.names)
        answer, std = np.transpose([(parameter.value, parameter.std) for parameter in fault.answer])
        tries = ((plain.theta, plain.std), (answer, std))
        wrong, right = (
            np.abs((theta - clean.theta) / np.hypot(own, clean.std)).max() for theta, own in tries
        )
        assert right < 3 < wrong
        errors.append([np.sqrt(np.mean((A @ (theta - clean.theta)) ** 2)) for theta, _ in tries])
    plains, mine = np.median(errors, axis=0)
    assert mine < gain * plains


def test_a_coarse_encoder_is_told_with_its_step() -> None:
    rig, log = bench("thesis")
    step = 2 * np.pi / 2**9
    q = step * np.round(log.q / step)
    coarse = replace(log, q=q, v=np.gradient(q, log.t, axis=0))
    fault, figures, _ = find("acceleration-noise", rig, coarse)
    assert "9 bits per turn" in fault.sentence
    assert figures["noise_share"] > 1


@pytest.mark.parametrize(("bits", "jitter"), [(19, 0.05), (16, 0.05), (19, 0.02)])
def test_stamps_that_jitter_are_no_noise_of_the_encoders(bits: int, jitter: float) -> None:
    """At 100 Hz 5 % of a period are worth 9 bits of an encoder of 19; the angles are true and the stamps are not."""
    rig = bundled("turret")
    step = 2 * np.pi / 2**bits
    log = prescribed(nominal(rig), seconds=20.0, torque_noise=0.01, dt=0.01)
    late = jitter * log.dt * np.random.default_rng(1).standard_normal(len(log))
    bad = replace(log, t=log.t + late, q=step * np.round(log.q / step), v=None)
    assert examine("acceleration-noise", rig, bad) is None


# ---- formulas in place of a torque ----


def moved(rig: Rig, seed: int, speed: float) -> tuple[Array, Array, Array, Array]:
    """Return times, angles, rates and accelerations of a motion at a speed."""
    motion = fourier(rig, seed, 20.0 * speed, 2e-3 * speed)
    return motion.t / speed, motion.q, motion.v * speed, motion.a * speed**2


@pytest.mark.parametrize(("name", "speed"), [("turret", 1.0), ("thesis", 0.1)])
def test_a_plants_own_torque_is_no_formula_and_a_speed_loops_is(name: str, speed: float) -> None:
    """Slow or fast, with friction, a bias and a spring, whatever the motion: a passive plant is silent."""
    rig = bundled(name)
    rng = np.random.default_rng(7)
    t, q, v, a = moved(rig, 0, speed)
    # One sine: there the acceleration is a multiple of the angle, and any delay fits.
    w = 2 * np.pi * rng.uniform(0.2, 1.0, rig.n) * speed
    sine = (0.5 * w**k * np.sin(np.outer(t, w) + k * np.pi / 2) for k in range(3))
    for motion in ((q, v, a), sine):
        q, v, a = motion
        tau = nominal(rig).inverse(q, v, a)
        size = np.sqrt(np.mean(tau**2, axis=0))
        tau += size * (0.3 + 0.5 * q + 0.01 * rng.standard_normal(q.shape))
        log = Log("plant", rig.joints, t, q, v + 1e-3 * rng.standard_normal(q.shape), tau)
        assert examine("controller-formula", rig, log) is None
        for delay in (0, 2, 5):
            find("controller-formula", rig, corrupted(log, "controller-formula", delay=delay))


@pytest.mark.parametrize(("name", "speed"), [("turret", 1.0), ("thesis", 0.1), ("drone", 0.1)])
def test_a_torque_that_only_cancels_gravity_is_a_formula_and_a_plants_own_is_none(
    name: str, speed: float
) -> None:
    """A hand moves the joint; beside it a plant, slow or fast, hardly any friction, a spring and cogging."""
    rig = bundled(name)
    t, q, v, a = moved(rig, 4, speed)
    noise = 1e-4 * np.random.default_rng(3).standard_normal(q.shape)
    weighed = compute_gravity(rig, q)
    size = np.maximum(np.sqrt(np.mean(weighed**2, axis=0)), 0.01)
    hand = Log("hand", rig.joints, t, q, v, weighed + size * (0.2 * q + noise))
    fault, figures, _ = find("controller-formula", rig, hand)
    assert fault.makes_physics_unreliable
    assert "formula of the angle" in fault.sentence
    assert figures["left"] < 1e-3
    tau = nominal(replace(rig, friction=0.01 * rig.friction)).inverse(q, v, a)
    tau += size * (2.0 * q + np.sin(12 * q) + noise)
    assert examine("controller-formula", rig, replace(hand, tau=tau)) is None


@pytest.mark.parametrize(("name", "stiffness"), [("turret", 0.0), ("thesis", 3.0), ("drone", -3.0)])
def test_a_counterbalance_is_no_fault(name: str, stiffness: float) -> None:
    """Twice the weight, by a constant force or a spring; the URDF's inertia is three times the true one."""
    rig = bundled(name)
    t, q, v, a = moved(rig, 6, 1.0)
    tau = nominal(replace(rig, friction=0.05 * rig.friction)).inverse(q, v, a)
    noise = 0.01 * np.random.default_rng(4).standard_normal(tau.shape)
    tau += np.sqrt(np.mean(tau**2, axis=0)) * (2.0 + stiffness * q + noise)
    for given in (rig, rig.with_phi(3.0 * rig.phi)):
        assert not check_log(given, Log("balanced", rig.joints, t, q, v, tau)).faults


@pytest.mark.parametrize("samples", [2, 30, 300])
def test_a_short_log_is_examined_without_complaint(samples: int) -> None:
    rig, log = bench("turret")
    assert check_log(rig, log.part(slice(0, samples))).is_reliable


def test_a_rig_that_never_moved_has_no_fault() -> None:
    rig, log = bench("turret")
    noise = 1e-3 * np.random.default_rng(0).standard_normal((2, *log.q.shape))
    still = Log("still", log.joints, log.t, np.zeros(log.q.shape), *noise)
    assert check_log(rig, still).is_reliable


# ---- real data ----

PENDULUM = ("t=time", "q_shoulder=position", "dq_shoulder=velocity", "tau_shoulder=torque")
DOUBLE = ("t=time", "q_shoulder=pos1", "dq_shoulder=vel1", "tau_shoulder=tau1")
DOUBLE += ("q_elbow=pos2", "dq_elbow=vel2", "tau_elbow=tau2")
MOTOR = ("t=Time", "q_motor=Position", "dq_motor=Velocity", "tau_motor=Iq*0.025")
TURNING = ("t=time_s", "q_motor=pos_counts*0.00076699", "tau_motor=iq_a*0.0276")


def real(urdf: str, file: str, columns: tuple[str, ...] = ()) -> CheckedLog:
    """Return what is found in a measured log of others, where it is there."""
    folder = (DATA / urdf).parent
    if not folder.is_dir():
        pytest.skip(f"../shared/data/{folder.name} is not there")
    rig = Rig.load(DATA / urdf)
    return check_log(rig, read_log(folder / file, rig, list(columns)))


def test_the_simple_pendulums_acceleration_is_noise_and_the_answer_is_the_physical_arm() -> None:
    found = real("dfki_simple_pendulum/pendulum.urdf", "system_identification.csv", PENDULUM)
    named = [fault.cause for fault in found.faults if not fault.slight]
    assert named == ["acceleration-noise"]
    assert found.is_reliable
    answer = {parameter.name: parameter.value for parameter in found.faults[-1].answer}
    assert 0.116 <= answer["arm.Iyy"] <= 0.173
    assert 0.230 <= abs(answer["arm.mz"]) <= 0.345


def test_the_speed_loops_current_is_its_formula_with_its_gain_and_delay() -> None:
    found = real("laas_anti_cogging/rotor.urdf", "speed_test1_off.csv", MOTOR)
    (fault,) = (one for one in found.faults if one.cause == "controller-formula")
    told = {parameter.name: parameter.value for parameter in fault.parameters}
    assert found.is_reliable
    assert told["left"] < 0.001
    assert told["gain"] == pytest.approx(0.025 * 0.087, rel=0.03)
    assert told["delay"] == pytest.approx(0.002, abs=1e-4)


def test_gravity_compensation_is_the_controllers_formula_of_the_angle() -> None:
    found = real("dfki_simple_pendulum/pendulum.urdf", "gravity_compensation.csv.gz", PENDULUM)
    assert not found.is_usable
    assert "controller-formula" in [x.cause for x in found.faults if x.makes_physics_unreliable]


@pytest.mark.parametrize(
    ("urdf", "file", "columns"),
    [
        ("odrive_cogging/rotor.urdf", "slow_a.csv", TURNING),
        ("ur10_unisa/ur10.urdf", "ur10_exciting.db3", ()),
        ("franka_fer_unisa/fer.urdf", "panda_unisa.db3", ()),
        (
            "dfki_double_pendulum/double_pendulum.urdf",
            "20220812-061157-PM_measured.csv",
            DOUBLE,
        ),
    ],
)
def test_a_measured_log_is_reliable(urdf: str, file: str, columns: tuple[str, ...]) -> None:
    """Also an arm's whose torque was smoothed or sampled at 30 Hz: that is no command."""
    found = real(urdf, file, columns)
    assert found.is_reliable
    assert "commanded-torque" not in [fault.cause for fault in found.faults]
