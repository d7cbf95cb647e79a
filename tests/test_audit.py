"""Every data fault is found by its own check and by no other; clean logs, dirty as real sensors are, show none."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.diagnosis.audit import CHECKS, Fault, audit, resolutions
from gimbal_pin.diagnosis.audit.clock import ticks
from gimbal_pin.diagnosis.audit.harm import harm
from gimbal_pin.diagnosis.audit.local import left_out
from gimbal_pin.diagnosis.audit.probe import probe, rows_at
from gimbal_pin.diagnosis.audit.quantisation import quantum
from gimbal_pin.errors import UsageError
from gimbal_pin.estimators import Estimate, weighted
from gimbal_pin.estimators.instrumental import Instrumented, instrumental, repeated
from gimbal_pin.experiment import bench_run
from gimbal_pin.io import read_log
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Block
from gimbal_pin.tuning import tune
from tests.bench_logs import fourier

DATA = Path(__file__).parents[2] / "shared" / "data"
CONTRACT = Path(__file__).parents[2] / "shared" / "CONTRACT.md"
NAMES = ("clock", "stuck-channel", "outliers", "filtered-velocity", "commanded-torque", "acceleration-noise")
BENCH = {"turret": ("turret", 14.0), "thesis": ("thesis", 16.0), "handheld": ("handheld", 12.0)}


@cache
def bench(name: str) -> tuple[Rig, Log]:
    """A rig on the bench for twenty seconds, with one per cent of noise on the torque."""
    rig = Rig.load(BENCH[name][0])
    model = nominal(rig)
    rng = np.random.default_rng(5)
    controller = tune(model).controller
    return rig, bench_run(model, controller, rng=rng, seconds=20.0, encoder_bits=BENCH[name][1])


@pytest.fixture
def turret() -> tuple[Rig, Log]:
    return bench("turret")


def unreliable(faults: tuple[Fault, ...]) -> list[str]:
    return [fault.cause for fault in faults if fault.makes_physics_unreliable]


def corrupted(log: Log, name: str, seed: int = 1, **shape: float) -> Log:
    return CHECKS[name].corrupt(log, np.random.default_rng(seed), **shape)


# ---- the matrix ----


def test_the_registry_is_the_contracts_list() -> None:
    assert tuple(CHECKS) == NAMES
    assert all(CHECKS[name].name == name for name in NAMES)
    if CONTRACT.is_file():
        row = next(line for line in CONTRACT.read_text(encoding="utf-8").splitlines() if line.startswith("| data |"))
        assert set(re.findall(r"`([a-z-]+)`", row)) == set(NAMES)


@pytest.mark.parametrize("planted", NAMES)
def test_a_fault_is_found_by_its_own_check_alone(turret: tuple[Rig, Log], planted: str) -> None:
    rig, log = turret
    bad = corrupted(log, planted)
    assert [name for name, check in CHECKS.items() if check.examine(rig, bad) is not None] == [planted]


@pytest.mark.parametrize("planted", NAMES)
def test_the_whole_audit_names_the_fault_on_three_axes(planted: str) -> None:
    rig, log = bench("thesis")
    found = audit(rig, corrupted(log, planted, seed=2))
    assert [fault.cause for fault in found.faults] == [planted]
    assert json.loads(json.dumps([fault.to_dict() for fault in found.faults]))[0]["status"] == "data"


def coloured(log: Log, size: float, corner: float, rng: np.random.Generator) -> Array:
    """First-order noise on every torque, as a share of its rms."""
    assert log.tau is not None
    keep = np.exp(-2 * np.pi * corner * log.dt)
    out = rng.standard_normal(log.tau.shape)
    for k in range(1, len(out)):
        out[k] = keep * out[k - 1] + np.sqrt(1 - keep**2) * out[k]
    return size * np.sqrt(np.mean(log.tau**2, axis=0)) * out


DIRTY: dict[str, Callable[[Log, np.random.Generator], Log]] = {
    "as recorded": lambda log, rng: log,
    "no rate": lambda log, rng: replace(log, v=None),
    "slow colour": lambda log, rng: replace(log, tau=log.tau + coloured(log, 0.015, 3.0, rng)),
    "fast colour, 250 Hz": lambda log, rng: replace(log, tau=log.tau + coloured(log, 0.015, 30.0, rng)).part(
        slice(None, None, 4)
    ),
    "biased, noisy rate": lambda log, rng: replace(log, v=log.v + 0.01 + 0.02 * rng.standard_normal(log.q.shape)),
}


@pytest.mark.parametrize("dirt", DIRTY)
@pytest.mark.parametrize("name", BENCH)
def test_clean_logs_are_reliable_however_dirty_the_sensors(name: str, dirt: str) -> None:
    rig, log = bench(name)
    found = audit(rig, DIRTY[dirt](log, np.random.default_rng(3)))
    assert found.reliable, [fault.sentence for fault in found.faults]
    assert [fault.cause for fault in found.faults] in ([], ["acceleration-noise"])


def test_a_command_without_noise_is_told_and_harms_nothing() -> None:
    """The drive's own report has noise; a simulator's has none, and is the controller's formula."""
    rig, model = Rig.load("turret"), nominal(Rig.load("turret"))
    rng, reference = np.random.default_rng(0), fourier(rig, 0, 8.0)
    log = bench_run(model, tune(model).controller, rng=rng, torque_noise=0.0, reference=reference)
    found = audit(rig, log)
    assert [fault.cause for fault in found.faults] == ["commanded-torque"] and found.reliable
    beyond = replace(log, tau=np.asarray(log.tau) * 1.5 * rig.tau_max / np.abs(log.tau).max(axis=0))
    assert unreliable(audit(rig, beyond).faults) == ["commanded-torque"]


# ---- what the checks measure ----


@pytest.mark.parametrize(("corner", "order"), [(5.0, 1.0), (10.0, 2.0), (25.0, 1.0)])
def test_the_corner_of_a_filtered_rate(turret: tuple[Rig, Log], corner: float, order: float) -> None:
    rig, log = turret
    fault = CHECKS["filtered-velocity"].examine(rig, corrupted(log, "filtered-velocity", corner=corner, order=order))
    assert fault is not None and fault.mended is not None and fault.mended.v is None
    figures = {parameter.name: parameter.value for parameter in fault.severity}
    assert abs(figures["corner"] / corner - 1) < 0.05 and figures["order"] == order


def test_a_delayed_rate_is_not_a_filtered_one(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    late = log.part(slice(3, None))
    assert CHECKS["filtered-velocity"].examine(rig, replace(late, v=np.asarray(log.v)[:-3])) is None


@pytest.mark.parametrize("jitter", [0.0, 0.1, 0.3])
def test_lost_samples_are_counted(jitter: float) -> None:
    rng = np.random.default_rng(0)
    kept = np.sort(rng.permutation(20_000)[:19_900])
    t = 1e-3 * (kept + np.clip(jitter * rng.standard_normal(len(kept)), -0.49, 0.49))
    seen = ticks(t)
    uncounted = abs(seen.missing.sum() - (kept[-1] - kept[0] + 1 - len(kept)))
    assert uncounted <= (0 if jitter < 0.2 else 50)
    assert abs(seen.jitter - np.std(t - 1e-3 * kept) / 1e-3) < 0.05
    # A lost sample that jitter hides makes its part's clock look slower by one in the part's samples.
    assert seen.drift < 2e-3 + 1.5 * uncounted / (len(kept) / len(seen.intervals))


def test_false_stamps_are_evened_and_true_ones_are_left() -> None:
    rig, log = bench("turret")
    jittered = corrupted(log, "clock", jitter=0.3, lost=0.0)
    fault = CHECKS["clock"].examine(rig, jittered)
    assert fault is not None and fault.mended is not None
    assert np.std(fault.mended.t - log.t) < 0.3 * np.std(jittered.t - log.t)
    rng = np.random.default_rng(1)
    odd = np.clip(log.t + 0.3e-3 * rng.standard_normal(len(log)), log.t - 0.49e-3, log.t + 0.49e-3)
    moved = [
        np.column_stack([np.interp(odd, log.t, column) for column in np.asarray(x).T]) for x in (log.q, log.v, log.tau)
    ]
    sampled = Log("sampled at odd times", log.joints, odd, *moved)
    true = CHECKS["clock"].examine(rig, sampled)
    assert true is not None and true.mended is None and not true.makes_physics_unreliable


def test_stuck_rows_are_cut_and_nothing_else(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    for channel, name in enumerate(("q", "v", "tau")):
        bad = corrupted(log, "stuck-channel", seed=channel, channel=channel, seconds=1.0)
        fault = CHECKS["stuck-channel"].examine(rig, bad)
        assert fault is not None and fault.mended is not None
        touched = np.flatnonzero(np.any(getattr(bad, name) != getattr(log, name), axis=1))
        assert not np.isin(log.t[touched], fault.mended.t).any()
        assert len(log) - len(fault.mended) < len(touched) + 0.1 / log.dt


def test_a_motor_that_is_off_is_not_stuck(turret: tuple[Rig, Log]) -> None:
    """A torque that rests with the joint is a measurement, if the model agrees."""
    rig, _ = turret
    model = nominal(rig)
    t = np.arange(0.0, 20.0, 1e-3)
    envelope = np.clip(np.abs(t - 10.0) - 2.0, 0.0, 1.0)[:, None]
    q = np.repeat(0.5 * np.sin(2.0 * t)[:, None] * envelope, rig.n, axis=1)
    v, a = np.gradient(q, 1e-3, axis=0), np.gradient(np.gradient(q, 1e-3, axis=0), 1e-3, axis=0)
    tau = model.inverse(q, v, a) + 1e-3 * np.random.default_rng(0).standard_normal(q.shape)
    still = np.abs(t - 10.0) < 1.9
    tau[still] = tau[np.flatnonzero(still)[0]]
    assert CHECKS["stuck-channel"].examine(rig, Log("rests", rig.joints, t, q, v, tau)) is None


def test_spikes_are_bridged(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    bad = corrupted(log, "outliers", channel=0.0, share=0.001)
    fault = CHECKS["outliers"].examine(rig, bad)
    assert fault is not None and fault.mended is not None and fault.makes_physics_unreliable
    hit = np.any(bad.q != log.q, axis=1)
    assert fault.severity[0].value == hit.sum()
    assert np.abs(fault.mended.q - log.q)[hit].max() < 0.01 * np.abs(bad.q - log.q)[hit].max()
    assert np.array_equal(fault.mended.q[~hit], log.q[~hit])


def test_what_has_no_fault_does_no_harm(turret: tuple[Rig, Log]) -> None:
    rig, log = turret
    assert np.all(harm(rig, log, log).error == 0.0) and not harm(rig, log, log).serious


# ---- noise in the regressor ----


@pytest.mark.parametrize("reference", [False, True])
def test_instruments_keep_what_least_squares_loses(reference: bool) -> None:
    """White noise on the angles: least squares is wrong by many of its deviations, the answer by few of its own."""
    rig, log = bench("thesis")
    known = replace(log, v=None, q_ref=log.q_ref if reference else None)
    noisy = corrupted(known, "acceleration-noise", angle=0.01)
    fault = CHECKS["acceleration-noise"].examine(rig, noisy)
    assert fault is not None and fault.makes_physics_unreliable
    clean, plain = (weighted(rows_at(probe(rig, one), 4.0)) for one in (log, noisy))
    assert [parameter.name for parameter in fault.answer] == list(probe(rig, log).names)
    answer, std = np.array([[parameter.value, parameter.std] for parameter in fault.answer]).T
    wrong = np.abs((plain.theta - clean.theta) / np.hypot(plain.std, clean.std)).max()
    right = np.abs((answer - clean.theta) / np.hypot(std, clean.std)).max()
    assert right < 3.5 < 5 < wrong
    A = np.concatenate([block.A for block in rows_at(probe(rig, log), 4.0)])
    errors = [np.sqrt(np.mean((A @ (theta - clean.theta)) ** 2)) for theta in (answer, plain.theta)]
    assert errors[0] < 0.6 * errors[1]


def regression(rng: np.random.Generator, rows: int = 400, noise: float = 0.0) -> tuple[Block, Block, Array]:
    """One block twice with independent noise in A, and theta."""
    theta, A = rng.uniform(0.5, 2.0, 4), rng.standard_normal((rows, 2, 4))
    b = A @ theta + 0.05 * rng.standard_normal((rows, 2))
    t, share = np.arange(rows) / 8.0, np.ones((rows, 2))
    twins = [Block(t, A + noise * rng.standard_normal(A.shape), b, np.ones((rows, 2)), share) for _ in range(2)]
    return twins[0], twins[1], theta


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_repeated_readings_do_not_care_which_comes_first(seed: int) -> None:
    first, second, _ = regression(np.random.default_rng(seed), noise=0.3)
    one, other = repeated([first], [second]), repeated([second], [first])
    assert np.allclose(one.theta, other.theta) and np.allclose(one.covariance, other.covariance)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_regressor_as_its_own_instrument_is_least_squares(seed: int) -> None:
    block, _, _ = regression(np.random.default_rng(seed))
    plain = weighted([block])
    for found in (instrumental([block], [block.A]), Instrumented((block.A,))([block]), repeated([block], [block])):
        assert np.allclose(found.theta, plain.theta, atol=1e-6)
        assert np.allclose(found.std, plain.std, rtol=0.05)


def test_instrumental_estimates_are_consistent_and_their_deviations_honest() -> None:
    errors: dict[str, list[Array]] = {"plain": [], "instrumental": [], "repeated": []}
    for seed in range(60):
        first, second, theta = regression(np.random.default_rng(seed), noise=0.5)
        for name, found in (
            ("plain", weighted([first])),
            ("instrumental", instrumental([first], [second.A])),
            ("repeated", repeated([first], [second])),
        ):
            errors[name].append((found.theta - theta) / found.std)
    scores = {name: np.array(each) for name, each in errors.items()}
    assert np.mean(scores["plain"]) < -5
    for name in ("instrumental", "repeated"):
        assert abs(np.mean(scores[name])) < 0.35
        assert 0.7 < np.std(scores[name]) < 1.3


def test_instruments_must_fit_the_rows() -> None:
    block, other, _ = regression(np.random.default_rng(0))
    for wrong in ([], [other.A[:-1]]):
        with pytest.raises(UsageError, match="instruments"):
            instrumental([block], wrong)
    with pytest.raises(UsageError, match="twins"):
        repeated([block], [])


def test_a_direction_without_instrument_has_infinite_deviation() -> None:
    block, other, _ = regression(np.random.default_rng(0))
    blind = block._replace(A=block.A * [1.0, 1.0, 1.0, 0.0])
    found: Estimate = instrumental([blind], [other.A * [1.0, 1.0, 1.0, 0.0]])
    assert np.isinf(found.std).tolist() == [False, False, False, True]


# ---- small laws ----


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.integers(0, 2**32 - 1))
def test_a_cubic_leaves_nothing_at_any_spacing(coefficients: list[float], seed: int) -> None:
    t = np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, 60))
    x = np.polyval(coefficients, t / 60.0)[:, None]
    assert np.abs(left_out(t, x)).max() < 1e-9 * (1 + np.abs(x).max())


def test_white_noise_leaves_its_own_deviation() -> None:
    rng = np.random.default_rng(0)
    for t in (np.arange(40_000.0), np.cumsum(rng.uniform(0.5, 1.5, 40_000))):
        assert abs(np.std(left_out(t, 0.3 * rng.standard_normal((len(t), 1)))) / 0.3 - 1) < 0.05


@given(st.integers(6, 20), st.integers(0, 2**32 - 1))
def test_the_step_of_an_encoder_is_found(bits: int, seed: int) -> None:
    rng, step = np.random.default_rng(seed), 2 * np.pi / 2**bits
    angle = 40 * step * np.sin(np.arange(3000) / 200.0) + step * rng.standard_normal(3000)
    assert quantum(step * np.round(angle / step)) == pytest.approx(step, rel=1e-6)
    assert quantum(angle) == 0.0


def test_resolutions_speak_of_coarse_encoders() -> None:
    _, log = bench("handheld")
    assert all(abs(each.bits - 12) < 1e-6 and each.sentence is None for each in resolutions(log))
    step = 2 * np.pi / 2**9
    coarse = replace(log, q=step * np.round(log.q / step))
    assert all("9 bits" in (each.sentence or "") for each in resolutions(coarse))


@pytest.mark.parametrize("name", NAMES)
def test_corruptions_repeat_with_their_generator_and_refuse_what_they_do_not_know(name: str) -> None:
    _, log = bench("turret")
    once, twice, other = (corrupted(log, name, seed=seed) for seed in (4, 4, 5))

    def same(x: Log, y: Log) -> bool:
        return all(np.array_equal(getattr(x, c), getattr(y, c)) for c in ("t", "q", "v", "tau"))

    assert same(once, twice) and not same(once, log)
    assert same(once, other) == (name in ("filtered-velocity", "commanded-torque"))
    with pytest.raises(UsageError, match="has no parameter 'colour'"):
        corrupted(log, name, colour=1.0)
    with pytest.raises(UsageError, match="give"):
        corrupted(log, name, **{CHECKS[name].shapes[0].name: -1.0})


@pytest.mark.parametrize("samples", [2, 30, 300])
def test_a_short_log_is_examined_without_complaint(samples: int) -> None:
    rig, log = bench("turret")
    assert audit(rig, log.part(slice(0, samples))).reliable


def test_a_rig_that_never_moved_has_no_fault() -> None:
    rig, log = bench("turret")
    rng, zero = np.random.default_rng(0), np.zeros(log.q.shape)
    noise = [1e-3 * rng.standard_normal(log.q.shape) for _ in range(2)]
    still = Log("still", log.joints, log.t, zero, *noise)
    assert audit(rig, still).reliable


# ---- real data ----


def real(folder: str, urdf: str, file: str, columns: dict[str, str]) -> tuple[Rig, Log]:
    if not (DATA / folder).is_dir():
        pytest.skip(f"../shared/data/{folder} is not there")
    rig = Rig.load(DATA / folder / urdf)
    return rig, read_log(DATA / folder / file, rig, [f"{ours}={theirs}" for ours, theirs in columns.items()])


PENDULUM = {"t": "time", "q_shoulder": "position", "dq_shoulder": "velocity", "tau_shoulder": "torque"}


def test_the_simple_pendulums_acceleration_is_noise_and_the_answer_is_the_physical_arm() -> None:
    rig, log = real("dfki_simple_pendulum", "pendulum.urdf", "system_identification.csv", PENDULUM)
    found = audit(rig, log)
    assert unreliable(found.faults) == ["acceleration-noise"]
    answer = {parameter.name: parameter.value for parameter in found.faults[-1].answer}
    assert 0.116 <= answer["arm.Iyy"] <= 0.173
    assert 0.230 <= abs(answer["arm.mz"]) <= 0.345


def double(file: str) -> tuple[Rig, Log]:
    columns = {"t": "time"}
    for k, joint in enumerate(("shoulder", "elbow"), start=1):
        columns |= {f"q_{joint}": f"pos{k}", f"dq_{joint}": f"vel{k}", f"tau_{joint}": f"tau{k}"}
    return real("dfki_double_pendulum", "double_pendulum.urdf", file, columns)


def test_the_double_pendulums_acceleration_is_good_and_its_torque_a_formula() -> None:
    """The torque of 061157 is ``-200 q_k + 180 q_{k-1}`` and what is smooth: 20 N m/rad and 0.6 N m s/rad at 300 Hz."""
    rig, log = double("20220812-061157-PM_measured.csv")
    found = {fault.cause: fault for fault in audit(rig, log).faults}
    assert "acceleration-noise" not in found
    assert unreliable(tuple(found.values())) == []
    figures = {parameter.name: parameter.value for parameter in found["commanded-torque"].severity}
    assert figures["stiffness"] == pytest.approx(20.0, abs=0.1)
    assert figures["damping"] == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize("file", ["20220812-055640-PM_measured.csv", "20220812-060143-PM_measured.csv"])
def test_the_other_double_pendulum_logs_were_commanded(file: str) -> None:
    rig, log = double(file)
    fault = CHECKS["commanded-torque"].examine(rig, log)
    assert fault is not None and not fault.makes_physics_unreliable


@pytest.mark.parametrize("part", "abc")
def test_the_turning_motors_logs_are_reliable(part: str) -> None:
    columns = {"t": "time_s", "q_motor": "pos_counts*0.00076699", "tau_motor": "iq_a*0.0276"}
    assert audit(*real("odrive_cogging", "rotor.urdf", f"slow_{part}.csv", columns)).reliable
