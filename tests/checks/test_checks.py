"""Every data fault is found by its own check and by no other; clean logs, dirty as real sensors are, show none."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from gimbal_pin.checks import CHECKS, CHECKS_WITHOUT_REPAIR, REASONS, Fault, check_log
from gimbal_pin.checks.harm import build_design
from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import compute_gravity, nominal
from gimbal_pin.log import Array, Log, read_log, signals, write_log
from gimbal_pin.regression import Filtering, fit_weighted
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed
from tests.checks.corruption import CORRUPTIONS
from tests.command_line import Run, result

DATA = Path(__file__).parents[3] / "shared" / "data"
CONTRACT = Path(__file__).parents[3] / "shared" / "CONTRACT.md"
NAMES = (
    "clock",
    "stuck-channel",
    "outliers",
    "controller-formula",
    "filtered-velocity",
    "commanded-torque",
    "acceleration-noise",
)
BENCH = {"turret": (14.0, 2e-3), "thesis": (16.0, 1e-3), "handheld": (12.0, 2e-3)}
"""Bits of the encoders, and sampling interval, s."""
FILTER = Filtering()


@cache
def bench(name: str) -> tuple[Rig, Log]:
    """A rig on the bench for twenty seconds, with one per cent of noise on the torque."""
    rig = Rig.load(name)
    (encoder, dt) = BENCH[name]
    model = nominal(rig)
    rng = np.random.default_rng(5)
    law = tune(model, bandwidth_hz=4.0, dt=dt).controller
    return rig, bench_run(model, law, rng=rng, seconds=20.0, encoder_bits=encoder)


@pytest.fixture
def turret() -> tuple[Rig, Log]:
    return bench("turret")


def unreliable(faults: tuple[Fault, ...]) -> list[str]:
    return [fault.cause for fault in faults if fault.makes_physics_unreliable]


def corrupted(log: Log, name: str, seed: int = 1, **size: Any) -> Log:
    return CORRUPTIONS[name](log, np.random.default_rng(seed), **size)


def figures(fault: Fault) -> dict[str, float]:
    return {parameter.name: parameter.value for parameter in fault.parameters}


# ---- the matrix ----


def test_every_check_bears_a_name_of_the_contract() -> None:
    assert tuple(CHECKS) == tuple(CORRUPTIONS) == NAMES
    if CONTRACT.is_file():
        row = next(
            line
            for line in CONTRACT.read_text(encoding="utf-8").splitlines()
            if line.startswith("| data |")
        )
        assert {*NAMES, "logs-disagree"} == {*re.findall(r"`([a-z-]+)`", row)}


def test_what_repairs_says_why() -> None:
    assert set(CHECKS) - CHECKS_WITHOUT_REPAIR <= set(REASONS)


@pytest.mark.parametrize("planted", NAMES)
def test_a_fault_is_found_by_its_own_check_alone(turret: tuple[Rig, Log], planted: str) -> None:
    rig, log = turret
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
def test_faults_of_other_kinds_and_sizes_are_named_mended_where_they_are_and_mended_once(
    planted: str, size: dict[str, Any]
) -> None:
    rig, log = bench("thesis")
    bad = corrupted(log, planted, seed=3, **size)
    found = check_log(rig, bad)
    assert [fault.cause for fault in found.faults] == [planted]
    told = json.loads(json.dumps([fault.to_dict() for fault in found.faults]))[0]
    assert told["status"] == "data" and told["class"] == [planted]
    assert (found.notes == ()) == told["makes_physics_unreliable"]
    assert {one.cause for one in found.alterations} <= {planted}
    assert (found.log is bad) == (not found.alterations)
    for prefix, channel in (("q", "q"), ("dq", "v"), ("tau", "tau")):
        if len(bad) == len(log) and planted in ("outliers", "stuck-channel"):
            for joint, wrong in zip(log.joints, (getattr(bad, channel) != getattr(log, channel)).T):
                mine = [
                    one for one in found.alterations if one.channel in ("", f"{prefix}_{joint}")
                ]
                at = log.t[wrong]
                assert not len(at) or any(one.first <= at[len(at) // 2] <= one.last for one in mine)
    again = check_log(rig, found.log) if found.alterations else found
    assert again.log is found.log and (again is found or not again.alterations)


@pytest.mark.parametrize("name", BENCH)
def test_a_clean_log_is_returned_as_it_is(name: str) -> None:
    rig, log = bench(name)
    found = check_log(rig, log)
    assert found.log is log and not found.alterations


def test_what_is_altered_is_what_differs(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    spiked = check_log(rig, bad := corrupted(log, "outliers", channel="q", share=0.001))
    hit = bad.q != spiked.log.q
    (j,) = np.flatnonzero(hit.any(axis=0))
    (one,) = spiked.alterations
    assert (one.kind, one.channel, one.samples, one.unit) == (
        "changed",
        f"q_{rig.joints[j]}",
        hit.sum(),
        "rad",
    )
    assert (
        one.size == pytest.approx(np.abs(bad.q - spiked.log.q).max())
        and np.isin([one.first, one.last], log.t).all()
    )
    slow = check_log(rig, corrupted(log, "filtered-velocity"))
    assert slow.log.v is None and {one.kind for one in slow.alterations} == {"channel-left-out"}
    assert [one.channel for one in slow.alterations] == [f"dq_{joint}" for joint in rig.joints]
    stale = check_log(rig, bad := corrupted(log, "clock", jitter=0.0, stale=0.2))
    assert [(one.kind, one.samples) for one in stale.alterations] == [
        ("rows-left-out", len(bad) - len(stale.log))
    ]


def test_verbs_list_what_they_alter(turret: tuple[Rig, Log], run: Run, tmp_path: Path) -> None:
    rig, log = turret
    path = tmp_path / "spikes.csv"
    write_log(corrupted(log, "outliers", channel="q", share=0.001), path)
    (shown,) = result(run, "inspect", path, "--rig", rig.name)["files"][0]["altered"]
    (fitted,) = result(run, "identify", rig.name, path)["altered"]
    assert (fitted["cause"], fitted["kind"], fitted["unit"]) == ("outliers", "changed", "rad")
    assert shown.items() <= fitted.items() and fitted["log"] == str(path)
    assert (
        f"altered: {path}: {fitted['channel']}: {fitted['samples']} samples"
        in run("identify", rig.name, path)[1]
    )


@pytest.mark.parametrize("planted", ["outliers", "stuck-channel"])
def test_the_order_of_a_logs_joints_does_not_matter(turret: tuple[Rig, Log], planted: str) -> None:
    rig, log = turret
    bad = corrupted(log, planted)
    turned = {name: x[:, ::-1] for name, x in bad.channels.items()}
    one = check_log(rig, bad)
    other = check_log(rig, replace(bad, joints=bad.joints[::-1], **turned))
    assert one.alterations == other.alterations and one.faults == other.faults
    np.testing.assert_array_equal(one.log.q, other.log.q)


def test_of_a_long_log_what_an_excerpt_shows_is_mended_everywhere() -> None:
    rig = Rig.load("turret")
    log = prescribed(nominal(rig), seconds=300.0, torque_noise=0.01, dt=5e-3)
    found = check_log(rig, corrupted(log, "outliers", channel="q", share=2e-3))
    assert np.abs(found.log.q - log.q).max() < 0.05 * np.std(log.q)
    assert check_log(rig, log).log is log


def coloured(log: Log, size: float, corner: float, rng: np.random.Generator) -> Array:
    """First-order noise on every torque, as a share of its rms."""
    assert log.tau is not None
    keep = np.exp(-2 * np.pi * corner * log.dt)
    out = rng.standard_normal(log.tau.shape)
    for k in range(1, len(out)):
        out[k] = keep * out[k - 1] + np.sqrt(1 - keep**2) * out[k]
    return size * np.sqrt(np.mean(log.tau**2, axis=0)) * out


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
def test_a_servos_law_harms_nothing_within_the_motors_limit_and_is_clipped_beyond(
    name: str,
) -> None:
    rig, log = bench(name)
    commanded = corrupted(log, "commanded-torque")
    found = CHECKS["commanded-torque"](rig, commanded, FILTER)
    assert found is not None and not found.fault.makes_physics_unreliable and not found.repairs
    size = 1.5 * rig.tau_max / np.abs(commanded.tau).max(axis=0)
    beyond = CHECKS["commanded-torque"](rig, replace(commanded, tau=commanded.tau * size), FILTER)
    assert beyond is not None and beyond.fault.makes_physics_unreliable
    assert np.all(np.abs(beyond.repairs[-1].tau) <= rig.tau_max)


@pytest.mark.parametrize(("name", "corner"), [("turret", 2.0), ("thesis", 5.0), ("handheld", 20.0)])
def test_a_torque_that_was_smoothed_off_line_is_not_commanded(name: str, corner: float) -> None:
    rig, log = bench(name)
    smooth = replace(
        log, tau=signals.zero_phase(np.asarray(log.tau), signals.lowpass(corner, 1.0 / log.dt))
    )
    for q_ref in (log.q_ref, None):
        assert not check_log(rig, replace(smooth, q_ref=q_ref)).faults


# ---- what the checks measure, and what they mend ----


@pytest.mark.parametrize(("corner", "order"), [(2.0, 1), (5.0, 1), (4.0, 2)])
def test_the_corner_of_a_filtered_rate(corner: float, order: int) -> None:
    rig, log = bench("thesis")
    found = CHECKS["filtered-velocity"](
        rig, corrupted(log, "filtered-velocity", corner=corner, order=order), FILTER
    )
    assert found is not None and found.repairs[-1].v is None
    seen = figures(found.fault)
    assert abs(seen["corner"] / corner - 1) < 0.15 and seen["order"] == order


def test_a_drive_that_filters_counts_of_its_own_is_seen_by_its_lag(turret: tuple[Rig, Log]) -> None:
    """The rate's own noise hides the recursion; the slow motion's shape shows the lag."""
    rig, log = turret
    filtered = corrupted(log, "filtered-velocity", corner=4.0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(log.q.shape)
    found = CHECKS["filtered-velocity"](rig, replace(filtered, v=filtered.v + noise), FILTER)
    assert found is not None and abs(figures(found.fault)["corner"] / 4.0 - 1) < 0.3


def test_a_delayed_rate_is_not_a_filtered_one_and_is_moved_to_its_time(
    turret: tuple[Rig, Log],
) -> None:
    rig, log = turret
    late = replace(log.part(slice(3, None)), v=np.asarray(log.v)[:-3])
    found = CHECKS["filtered-velocity"](rig, late, FILTER)
    assert (
        found is not None
        and "low-pass" not in found.fault.sentence
        and "6 ms later" in found.fault.sentence
    )
    assert abs(figures(found.fault)["delay"] / (3 * log.dt) - 1) < 0.05 and "corner" not in figures(
        found.fault
    )
    assert (
        found.repairs[-1].v is not None
        and CHECKS["filtered-velocity"](rig, found.repairs[-1], FILTER) is None
    )


def test_a_coarse_rate_that_repeats_itself_is_late_and_behind_no_low_pass() -> None:
    """A servo's rate: the mean of the last 40 ms in steps, over rows that repeat the row before."""
    rig = Rig.load("turret")
    log = prescribed(nominal(rig), seconds=6.0, dt=5e-3)
    mean = (log.q[8:] - log.q[:-8]) / 0.04
    v = 0.05 * np.round(mean / 0.05)
    for k in range(1, len(v), 2):
        v[k] = v[k - 1]
    found = CHECKS["filtered-velocity"](rig, replace(log.part(slice(8, None)), v=v), FILTER)
    assert (
        found is not None and "low-pass" not in found.fault.sentence + found.fault.next_experiment
    )
    assert figures(found.fault)["delay"] == pytest.approx(0.0225, abs=0.003)


def test_false_stamps_are_evened_and_true_ones_are_left() -> None:
    rig, log = bench("turret")
    jittered = corrupted(log, "clock", jitter=0.3)
    found = CHECKS["clock"](rig, jittered, FILTER)
    assert found is not None
    assert np.std(found.repairs[-1].t - log.t) < 0.3 * np.std(jittered.t - log.t)
    rng = np.random.default_rng(1)
    odd = np.clip(log.t + 0.3e-3 * rng.standard_normal(len(log)), log.t - 0.49e-3, log.t + 0.49e-3)
    channels = [np.asarray(x) for x in (log.q, log.v, log.tau)]
    moved = [np.column_stack([np.interp(odd, log.t, column) for column in x.T]) for x in channels]
    sampled = Log("sampled at odd times", log.joints, odd, *moved)
    true = CHECKS["clock"](rig, sampled, FILTER)
    assert true is not None and not true.repairs and not true.fault.makes_physics_unreliable


def test_repeated_rows_are_left_out(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    stale = corrupted(log, "clock", jitter=0.0, stale=0.2)
    found = CHECKS["clock"](rig, stale, FILTER)
    assert found is not None
    repeats = np.append(False, np.all(np.diff(np.asarray(stale.tau), axis=0) == 0, axis=1))
    assert figures(found.fault)["stale"] == pytest.approx(0.2, abs=0.06)
    assert len(log) - len(found.repairs[-1]) == pytest.approx(repeats.sum(), rel=0.02)


@pytest.mark.parametrize("channel", ["q", "v", "tau"])
def test_stuck_rows_are_cut_and_nothing_else(turret: tuple[Rig, Log], channel: str) -> None:
    rig, log = turret
    bad = corrupted(log, "stuck-channel", seed=2, channel=channel, seconds=1.0)
    found = CHECKS["stuck-channel"](rig, bad, FILTER)
    assert found is not None and figures(found.fault)["longest"] == pytest.approx(1.0, abs=0.05)
    touched = np.flatnonzero(np.any(getattr(bad, channel) != getattr(log, channel), axis=1))
    assert not np.isin(log.t[touched], found.repairs[-1].t).any()
    assert len(log) - len(found.repairs[-1]) < len(touched) + 0.1 / log.dt


@pytest.mark.parametrize("share", [0.05, 0.15])
def test_a_smooth_torque_in_coarse_steps_is_not_stuck(
    turret: tuple[Rig, Log], share: float
) -> None:
    """A drive that filters its current and reports it in steps rests on each for long."""
    rig, log = turret
    smooth = gaussian_filter1d(np.asarray(log.tau), 0.008 / log.dt, axis=0)
    step = share * np.std(smooth, axis=0)
    coarse = replace(log, tau=step * np.round(smooth / step))
    assert CHECKS["stuck-channel"](rig, coarse, FILTER) is None


def test_a_motor_that_is_off_is_not_stuck(turret: tuple[Rig, Log]) -> None:
    """A torque that rests with the joint is a measurement, if the model agrees."""
    rig, _ = turret
    model = nominal(rig)
    t = np.arange(0.0, 20.0, 1e-3)
    envelope = np.clip(np.abs(t - 10.0) - 2.0, 0.0, 1.0)[:, None]
    q = np.repeat(0.5 * np.sin(2.0 * t)[:, None] * envelope, rig.n, axis=1)
    v = np.gradient(q, 1e-3, axis=0)
    a = np.gradient(np.gradient(q, 1e-3, axis=0), 1e-3, axis=0)
    tau = model.inverse(q, v, a) + 1e-3 * np.random.default_rng(0).standard_normal(q.shape)
    still = np.abs(t - 10.0) < 1.9
    tau[still] = tau[np.flatnonzero(still)[0]]
    assert CHECKS["stuck-channel"](rig, Log("rests", rig.joints, t, q, v, tau), FILTER) is None


def test_spikes_are_bridged(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    bad = corrupted(log, "outliers", channel="q", share=0.001)
    found = CHECKS["outliers"](rig, bad, FILTER)
    assert found is not None and found.fault.makes_physics_unreliable
    hit = np.any(bad.q != log.q, axis=1)
    assert figures(found.fault)["spikes"] == hit.sum()
    assert np.abs(found.repairs[-1].q - log.q)[hit].max() < 0.01 * np.abs(bad.q - log.q)[hit].max()
    assert np.array_equal(found.repairs[-1].q[~hit], log.q[~hit])


@pytest.mark.parametrize(
    ("share", "said"), [(0.0, "1 lone wild sample,"), (3e-4, "3 lone wild samples,")]
)
def test_spikes_are_counted_in_words_that_agree(
    turret: tuple[Rig, Log], share: float, said: str
) -> None:
    rig, log = turret
    share = share * 1e4 / len(log)
    found = CHECKS["outliers"](rig, corrupted(log, "outliers", channel="q", share=share), FILTER)
    assert found is not None and said in found.fault.sentence


def test_garbage_is_cut_out(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    bad = corrupted(log, "outliers", channel="v", seconds=1.5)
    found = CHECKS["outliers"](rig, bad, FILTER)
    assert found is not None and found.fault.makes_physics_unreliable
    touched = log.t[np.any(bad.v != log.v, axis=1)]
    assert np.mean(np.isin(touched, found.repairs[-1].t)) < 0.05
    assert len(log) - len(found.repairs[-1]) < len(touched) + 0.3 / log.dt


@pytest.mark.parametrize("seed", range(3))
def test_a_knock_is_not_cut_out(turret: tuple[Rig, Log], seed: int) -> None:
    """A gap that closes, or a hand that knocks the rig, makes a jump that dies away, not noise."""
    rig, log = turret
    tau = np.array(log.tau)
    rng = np.random.default_rng(seed)
    for k in rng.integers(500, len(log) - 500, 3):
        tau[k : k + 100] += 8.0 * np.std(tau, axis=0) * np.exp(-np.arange(100) / 3.0)[:, None]
    found = CHECKS["outliers"](rig, replace(log, tau=tau), FILTER)
    assert found is None or figures(found.fault)["garbage"] == 0.0


@pytest.mark.parametrize("name", BENCH)
def test_a_drive_that_chatters_has_no_outliers(name: str) -> None:
    """Kicks at encoder steps, bursts that change sign with every sample, and noise of heavy tails."""
    rig, log = bench(name)
    rng = np.random.default_rng(2)
    size = np.std(log.tau, axis=0)
    length = round(0.2 / log.dt)
    burst = ((-1.0) ** np.arange(length) * np.hanning(length))[:, None]
    bursts = np.zeros(log.q.shape)
    for begin in rng.integers(0, len(log) - length, 15):
        bursts[begin : begin + length] += 3.0 * burst
    kicks = np.diff(np.floor(log.q / 0.1), axis=0, prepend=np.floor(log.q[:1] / 0.1))
    for chatter in (kicks, bursts, 0.05 * rng.standard_t(3, log.q.shape)):
        found = CHECKS["outliers"](rig, replace(log, tau=log.tau + size * chatter), FILTER)
        assert found is None, found.fault.sentence


# ---- noise in the regressor ----


@pytest.mark.parametrize("reference", [False, True])
def test_instruments_keep_what_least_squares_loses(reference: bool) -> None:
    """White noise on the angles: least squares is wrong by many of its deviations, the answer by few of its own.

    Without a reference each half of the samples is the other's instrument, as noisy as what it stands for: such an
    answer scatters more, by what its deviations say of it, and need only be nearer over several draws of the noise.
    """
    rig, log = bench("thesis")
    known = replace(log, v=None, q_ref=log.q_ref if reference else None)
    made = build_design(rig, log, FILTER)
    clean = fit_weighted(list(made))
    A = np.concatenate([block.A for block in made])
    errors = []
    for seed in range(1 if reference else 3):
        noisy = corrupted(known, "acceleration-noise", seed=seed, angle=0.01)
        found = CHECKS["acceleration-noise"](rig, noisy, FILTER)
        assert found is not None and found.fault.makes_physics_unreliable
        plain = fit_weighted(list(build_design(rig, noisy, FILTER)))
        assert [parameter.name for parameter in found.fault.answer] == list(made.names)
        answer, std = np.array(
            [[parameter.value, parameter.std] for parameter in found.fault.answer]
        ).T
        wrong = np.abs((plain.theta - clean.theta) / np.hypot(plain.std, clean.std)).max()
        right = np.abs((answer - clean.theta) / np.hypot(std, clean.std)).max()
        assert wrong > 3 and right < (2.5 if reference else 3.0)
        errors.append(
            [np.sqrt(np.mean((A @ (theta - clean.theta)) ** 2)) for theta in (answer, plain.theta)]
        )
    mine, plains = np.median(errors, axis=0)
    assert mine < (0.6 if reference else 1.0) * plains


def test_a_coarse_encoder_is_told_with_its_step() -> None:
    rig, log = bench("thesis")
    step = 2 * np.pi / 2**9
    q = step * np.round(log.q / step)
    coarse = replace(log, q=q, v=np.gradient(q, log.t, axis=0))
    found = {fault.cause: fault for fault in check_log(rig, coarse).faults}
    assert "9 bits per turn" in found["acceleration-noise"].sentence
    assert figures(found["acceleration-noise"])["noise_share"] > 1


@pytest.mark.parametrize(("bits", "jitter"), [(19, 0.05), (16, 0.05), (19, 0.02)])
def test_stamps_that_jitter_are_no_noise_of_the_encoders(bits: int, jitter: float) -> None:
    """At 100 Hz 5 % of a period are worth 9 bits of an encoder of 19; the angles are true and the stamps are not."""
    rig = Rig.load("turret")
    step = 2 * np.pi / 2**bits
    log = prescribed(nominal(rig), seconds=20.0, torque_noise=0.01, dt=0.01)
    late = jitter * log.dt * np.random.default_rng(1).standard_normal(len(log))
    bad = replace(log, t=log.t + late, q=step * np.round(log.q / step), v=None)
    assert CHECKS["acceleration-noise"](rig, bad, FILTER) is None


@pytest.mark.parametrize(("name", "speed"), [("turret", 1.0), ("thesis", 0.1)])
def test_a_plants_own_torque_is_no_formula_and_a_speed_loops_is(name: str, speed: float) -> None:
    """Slow or fast, with friction, a bias and a spring, whatever the motion: a passive plant is silent."""
    rig = Rig.load(name)
    model = nominal(rig)
    check = CHECKS["controller-formula"]
    rng = np.random.default_rng(7)
    for seed in range(3):
        motion = fourier(rig, seed, 20.0 * speed, 2e-3 * speed)
        t = motion.t / speed
        q = motion.q
        v = motion.v * speed
        a = motion.a * speed**2
        if (
            seed == 2
        ):  # one sine: there the acceleration is a multiple of the angle, and any delay fits
            w = 2 * np.pi * rng.uniform(0.2, 1.0, rig.n) * speed
            q, v, a = (0.5 * w**k * np.sin(np.outer(t, w) + k * np.pi / 2) for k in range(3))
        tau = model.inverse(q, v, a)
        size = np.sqrt(np.mean(tau**2, axis=0))
        tau = tau + size * (0.3 + 0.5 * q + 0.01 * rng.standard_normal(q.shape))
        log = Log("plant", rig.joints, t, q, v + 1e-3 * rng.standard_normal(q.shape), tau)
        assert check(rig, log, FILTER) is None
        for delay in (0, 2, 5):
            assert check(rig, corrupted(log, "controller-formula", delay=delay), FILTER) is not None


@pytest.mark.parametrize(
    ("name", "speed"), [("turret", 1.0), ("thesis", 0.1), ("ptu", 1.0), ("drone", 0.1)]
)
def test_a_torque_that_only_cancels_gravity_is_a_formula_and_a_plants_own_is_none(
    name: str, speed: float
) -> None:
    """A hand moves the joint; beside it a plant, slow or fast, hardly any friction, a spring and cogging."""
    rig = Rig.load(name)
    check = CHECKS["controller-formula"]
    rng = np.random.default_rng(3)
    smooth = nominal(replace(rig, friction=0.01 * rig.friction))
    motion = fourier(rig, 4, 20.0 * speed, 2e-3 * speed)
    t = motion.t / speed
    q = motion.q
    v = motion.v * speed
    a = motion.a * speed**2
    noise = 1e-4 * rng.standard_normal(q.shape)
    weighed = compute_gravity(rig, q)
    size = np.maximum(np.sqrt(np.mean(weighed**2, axis=0)), 0.01)
    hand = Log("hand", rig.joints, t, q, v, weighed + size * (0.2 * q + noise))
    found = check(rig, hand, FILTER)
    assert found is not None and found.fault.makes_physics_unreliable
    assert "formula of the angle" in found.fault.sentence and figures(found.fault)["left"] < 1e-3
    tau = smooth.inverse(q, v, a) + size * (2.0 * q + np.sin(12 * q) + noise)
    assert check(rig, replace(hand, tau=tau), FILTER) is None


@pytest.mark.parametrize(("name", "stiffness"), [("turret", 0.0), ("thesis", 3.0), ("drone", -3.0)])
def test_a_counterbalance_is_no_fault(name: str, stiffness: float) -> None:
    """Twice the weight, by a constant force or a spring; the URDF's inertia is three times the true one."""
    rig = Rig.load(name)
    motion = fourier(rig, 6, 20.0, 2e-3)
    smooth = nominal(replace(rig, friction=0.05 * rig.friction))
    tau = smooth.inverse(motion.q, motion.v, motion.a)
    size = np.sqrt(np.mean(tau**2, axis=0))
    tau = tau + size * (
        2.0 + stiffness * motion.q + 0.01 * np.random.default_rng(4).standard_normal(tau.shape)
    )
    stated = rig.with_phi(3.0 * rig.phi)
    for given in (rig, stated):
        assert not check_log(
            given, Log("balanced", rig.joints, motion.t, motion.q, motion.v, tau)
        ).faults


@pytest.mark.parametrize("name", NAMES)
def test_corruptions_repeat_with_their_generator(name: str) -> None:
    _, log = bench("turret")
    once, twice, other = (corrupted(log, name, seed=seed) for seed in (4, 4, 5))

    def same(x: Log, y: Log) -> bool:
        return all(np.array_equal(getattr(x, c), getattr(y, c)) for c in ("t", "q", "v", "tau"))

    assert same(once, twice) and not same(once, log)
    assert same(once, other) == (name in ("filtered-velocity", "commanded-torque"))


@pytest.mark.parametrize("samples", [2, 30, 300])
def test_a_short_log_is_examined_without_complaint(samples: int) -> None:
    rig, log = bench("turret")
    assert check_log(rig, log.part(slice(0, samples))).is_reliable


def test_a_rig_that_never_moved_has_no_fault() -> None:
    rig, log = bench("turret")
    rng = np.random.default_rng(0)
    zero = np.zeros(log.q.shape)
    noise = [1e-3 * rng.standard_normal(log.q.shape) for _ in range(2)]
    still = Log("still", log.joints, log.t, zero, *noise)
    assert check_log(rig, still).is_reliable


# ---- real data ----


def real(folder: str, urdf: str, file: str, columns: dict[str, str]) -> tuple[Rig, Log]:
    if not (DATA / folder).is_dir():
        pytest.skip(f"../shared/data/{folder} is not there")
    rig = Rig.load(DATA / folder / urdf)
    return rig, read_log(
        DATA / folder / file, rig, [f"{ours}={theirs}" for ours, theirs in columns.items()]
    )


PENDULUM = {
    "t": "time",
    "q_shoulder": "position",
    "dq_shoulder": "velocity",
    "tau_shoulder": "torque",
}


def test_the_simple_pendulums_acceleration_is_noise_and_the_answer_is_the_physical_arm() -> None:
    rig, log = real("dfki_simple_pendulum", "pendulum.urdf", "system_identification.csv", PENDULUM)
    found = check_log(rig, log)
    assert [fault.cause for fault in found.faults if not fault.slight] == [
        "acceleration-noise"
    ] and found.is_reliable
    answer = {parameter.name: parameter.value for parameter in found.faults[-1].answer}
    assert 0.116 <= answer["arm.Iyy"] <= 0.173
    assert 0.230 <= abs(answer["arm.mz"]) <= 0.345


@pytest.mark.parametrize("run", ["061157", "055640", "060143"])
def test_the_double_pendulums_logs_show_physics(run: str) -> None:
    columns = {"t": "time"}
    for k, joint in enumerate(("shoulder", "elbow"), start=1):
        columns |= {f"q_{joint}": f"pos{k}", f"dq_{joint}": f"vel{k}", f"tau_{joint}": f"tau{k}"}
    rig, log = real(
        "dfki_double_pendulum", "double_pendulum.urdf", f"20220812-{run}-PM_measured.csv", columns
    )
    found = check_log(rig, log)
    assert found.is_reliable


def test_the_speed_loops_current_is_its_formula_with_its_gain_and_delay() -> None:
    columns = {"t": "Time", "q_motor": "Position", "dq_motor": "Velocity", "tau_motor": "Iq*0.025"}
    rig, log = real("laas_anti_cogging", "rotor.urdf", "speed_test1_off.csv", columns)
    found = check_log(rig, log)
    told = figures(next(fault for fault in found.faults if fault.cause == "controller-formula"))
    assert found.is_reliable and told["left"] < 0.001
    assert told["gain"] == pytest.approx(0.025 * 0.087, rel=0.03) and told[
        "delay"
    ] == pytest.approx(0.002, abs=1e-4)


def test_gravity_compensation_is_the_controllers_formula_of_the_angle() -> None:
    rig, log = real(
        "dfki_simple_pendulum", "pendulum.urdf", "gravity_compensation.csv.gz", PENDULUM
    )
    found = check_log(rig, log)
    assert not found.is_usable and "controller-formula" in unreliable(found.faults)
    assert "neither friction nor inertia" in found.faults[0].sentence


@pytest.mark.parametrize("part", "abc")
def test_the_turning_motors_logs_are_reliable(part: str) -> None:
    columns = {"t": "time_s", "q_motor": "pos_counts*0.00076699", "tau_motor": "iq_a*0.0276"}
    assert check_log(*real("odrive_cogging", "rotor.urdf", f"slow_{part}.csv", columns)).is_reliable


@pytest.mark.parametrize(
    ("folder", "urdf", "file"),
    [
        ("ur10_unisa", "ur10.urdf", "ur10_exciting.db3"),
        ("franka_fer_unisa", "fer.urdf", "panda_unisa.db3"),
    ],
)
def test_torques_of_an_arm_that_were_smoothed_or_sampled_at_30_hz_are_no_command(
    folder: str, urdf: str, file: str
) -> None:
    found = check_log(*real(folder, urdf, file, {}))
    assert found.is_reliable and "commanded-torque" not in [fault.cause for fault in found.faults]
