"""Laws of identification.

Planted parameters come back within their deviations, which hold what the model misses; unseen ones are refused; what
holds of a part of the data alone is doubted; logs of one rig agree within chance, and of others what differs is found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import nominal, plant_with, reduce_parameters
from gimbal_pin.effects import Cogging, PayloadShift, parse_effect
from gimbal_pin.errors import DataError, GimbalPinError, UsageError
from gimbal_pin.identification import (
    ESTIMATORS,
    Agreement,
    Opinion,
    identify,
    identify_new,
    keep_held_out_accuracy,
    read_known,
    read_model,
    split_logs,
    write_model,
)
from gimbal_pin.identification.bodies import estimate_bodies
from gimbal_pin.log import Log
from gimbal_pin.regression import (
    add_misfit,
    compute_blocks,
    compute_deformation_root,
    find_likeliest_bodies,
    fit_weighted,
    map_phi_to_base,
)
from gimbal_pin.rig import Rig, is_physical
from tests.bench_logs import EXACT, prescribed, rows_of, true_theta
from tests.identification.logs import hold, record
from tests.rigs import bundled, chain

RIG = bundled("turret")
CLEAN = prescribed(nominal(RIG), seconds=12.0)
NOISY = prescribed(nominal(RIG), seconds=12.0, torque_noise=0.01, dt=2e-3)


@pytest.mark.parametrize(
    ("rig", "seconds"), [(bundled("thesis"), 12.0), (RIG, 12.0), (chain(12), 8.0)]
)
def test_log_without_noise_gives_the_parameters_back(rig: Rig, seconds: float) -> None:
    log = prescribed(nominal(rig), seconds=seconds, dt=2e-3)
    found = identify(rig, [log], filtering=EXACT, holdout="none")
    planted = true_theta(rig)
    scale = np.abs(planted).max()
    np.testing.assert_allclose(found.estimate.theta, planted, atol=1e-5 * scale)
    np.testing.assert_allclose(found.stated, planted, atol=1e-9 * scale)
    assert min(found.train.fit_percent.values()) > 99.5


@pytest.mark.parametrize("name", ESTIMATORS)
def test_estimators_agree_without_noise_and_know_a_stated_rotor(name: str) -> None:
    """Output error sees the jumps of a torque between two samples, up to a sample off."""
    motors = tuple(replace(motor, gear_ratio=6.0, rotor_inertia=2e-4) for motor in RIG.motors)
    geared = replace(RIG, motors=motors)
    log = prescribed(nominal(geared), 1, seconds=8.0, dt=2e-3)
    found = identify(geared, [log], estimator=ESTIMATORS[name], filtering=EXACT)
    planted = true_theta(geared)
    near = 1e-3 if name == "output-error" else 1e-4
    np.testing.assert_allclose(found.estimate.theta, planted, atol=near * np.abs(planted).max())
    assert found.estimate.method == name
    np.testing.assert_allclose(found.model.rig.armature, 6.0**2 * 2e-4)
    assert not found.model.armature.any()


def test_motion_to_and_fro_keeps_its_turns() -> None:
    """A rate that turns every few periods of the filter accelerates most where it turns."""
    w = 2 * np.pi * np.array([1.1, 1.4])
    t = 1e-3 * np.arange(12000)[:, None]
    q = 0.3 * np.sin(w * t)
    v = 0.3 * w * np.cos(w * t)
    tau = nominal(RIG).inverse_dynamics(q, v, -(w**2) * q)
    tau += 0.01 * np.std(tau, axis=0) * np.random.default_rng(0).standard_normal(tau.shape)
    found = identify(RIG, [Log("fast", RIG.joints, t[:, 0], q, v, tau)], filtering=EXACT)
    assert min(found.train.used.values()) > 0.6
    assert found.held_out is not None
    assert min(found.held_out.fit_percent.values()) > 99.0


def test_deviations_are_calibrated() -> None:
    z = []
    for seed in range(8):
        found = identify(RIG, [record(RIG, seed, 12.0)], filtering=EXACT, holdout="none").estimate
        z.append((found.theta - true_theta(RIG)) / found.std)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert np.abs(z).max() < 4.5


def test_simulated_sensors_leave_the_errors_within_their_deviations() -> None:
    rig = bundled("thesis", "zoom-lens")
    found = identify(rig, [bench_run(nominal(rig), rng=1, seconds=12)])
    assert np.all(np.abs(found.estimate.theta - true_theta(rig)) < 4 * found.estimate.std)
    assert found.held_out is not None
    assert min(found.held_out.fit_percent.values()) > 95


SHAKEN = 0.05 * np.random.default_rng(0).standard_normal(CLEAN.q.shape)
REFUSED: dict[str, tuple[Log, type[GimbalPinError], str]] = {
    "joint at rest": (hold(RIG, NOISY, 1), DataError, "tilt"),
    "a third of a second": (CLEAN.part(slice(0, 300)), DataError, "more"),
    "no torque": (replace(CLEAN, tau=None), UsageError, "tau_<joint>"),
    "noisy angles": (
        replace(CLEAN, q=CLEAN.q + SHAKEN, v=None),
        DataError,
        "rate's noise.*finer angles",
    ),
    "one sample": (CLEAN.part(slice(0, 1)), DataError, "one sample"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_logs_that_show_too_little_are_refused(kind: str) -> None:
    log, error, words = REFUSED[kind]
    with pytest.raises(error, match=words) as caught:
        identify(RIG, [log], filtering=EXACT)
    assert "\n" not in str(caught.value)


def test_held_out_part_is_last_in_time() -> None:
    (train,), (test,), how = split_logs([CLEAN], None, EXACT)
    assert how == "last third"
    assert len(train) == pytest.approx(2 / 3 * len(CLEAN), rel=1e-3)
    np.testing.assert_array_equal(np.append(train.t, test.t), CLEAN.t)
    for asked, how in ((None, "log 3 of 3"), ("log:1", "log 1 of 3")):
        assert split_logs([CLEAN] * 3, asked, EXACT)[2] == how
    assert split_logs([CLEAN], "none", EXACT)[1] == ()
    for wrong in ("log:4", "log:0", "half"):
        with pytest.raises(UsageError):
            split_logs([CLEAN] * 3, wrong, EXACT)


def test_refit_learns_from_all_and_keeps_the_held_out_accuracy() -> None:
    logs = [prescribed(nominal(RIG), seed, 8.0, 0.05, 4e-3) for seed in (1, 2)]
    held, whole = (identify(RIG, logs, filtering=EXACT, holdout=how) for how in (None, "none"))
    final = keep_held_out_accuracy(held, whole)
    np.testing.assert_array_equal(final.estimate.theta, whole.estimate.theta)
    assert final.held_out == held.held_out is not None
    assert np.median(final.estimate.std / held.estimate.std) < 0.9


# --- What the model misses --------------------------------------------------------------------------


@cache
def take(teeth: float = 0.0, noise: float = 0.01) -> Log:
    """Return a log of the turret with seven teeth per turn at tilt, N m."""
    effect = parse_effect(f"cogging:tilt:amplitude={teeth},harmonic=7", RIG)
    plant = plant_with(nominal(RIG), [effect] if teeth else []).plant
    return prescribed(plant, 1, 16.0, torque_noise=noise, dt=4e-3)


def ripple(log: Log, size: float) -> Log:
    """Return the log with 14 waves per turn at its first joint, as a share of its torque."""
    tau = np.array(log.tau)
    tau[:, 0] += size * np.std(tau[:, 0]) * np.sin(14 * log.q[:, 0] + 0.7)
    return replace(log, tau=tau)


def test_deviations_hold_a_ripple() -> None:
    blocks = compute_blocks(rows_of(RIG, ripple(take(), 1.0)))
    plain = fit_weighted(blocks)
    wide, _ = add_misfit(blocks, plain)
    np.testing.assert_array_equal(wide.theta, plain.theta)
    error = plain.theta - true_theta(RIG)
    assert np.sqrt(np.mean((error / wide.std) ** 2)) < 1.25
    assert np.all(wide.std >= plain.std)


@pytest.mark.parametrize(
    ("size", "noise", "pan"),
    [
        (1.0, 0.01, Opinion.NOT_EXPLAINED),
        (0.05, 1e-3, Opinion.STRUCTURE_LEFT),
        (0.0, 0.1, Opinion.EXPLAINED),
    ],
)
def test_opinion_tells_structure_from_noise(size: float, noise: float, pan: Opinion) -> None:
    found = identify(RIG, [ripple(take(noise=noise), size)], filtering=EXACT)
    assert found.opinions == {"pan": pan, "tilt": Opinion.EXPLAINED}
    is_first = [said.startswith("pan is not explained: ") for said in found.warnings[:1]]
    assert any(is_first) == (pan is Opinion.NOT_EXPLAINED)


def test_intervals_of_bodies_hold_the_truth() -> None:
    """Bodies drawn as far from the URDF's as the trust says, base parameters with noise."""
    trust = 0.1
    rig = bundled("turret", "cinema")
    rng = np.random.default_rng(3)
    mixing = map_phi_to_base(rig, reduce_parameters(rig))
    root = trust * compute_deformation_root(rig.phi)
    std = 1e-3 * np.abs(mixing @ rig.phi) + 1e-5
    hits = []
    for _ in range(12):
        true = rig.phi + root @ rng.standard_normal(root.shape[1])
        if not is_physical(true):
            continue
        beta = mixing @ true + std * rng.standard_normal(len(std))
        given = (mixing, beta, np.diag(std**2), trust)
        phi = find_likeliest_bodies(rig.phi, *given)
        stated = estimate_bodies(rig.links, rig.phi, phi, *given)
        for body, own in zip(stated, true.reshape(-1, 10)):
            inertia = pin.Inertia.FromDynamicParameters(own)
            expected = (inertia.mass, *inertia.lever, *inertia.inertia[np.tril_indices(3)])
            hits += [
                abs(figure.value - x) <= 1.96 * figure.std
                for figure, x in zip((body.mass, *body.com, *body.inertia), expected)
                if figure.std > 1e-12
            ]
    assert len(hits) > 150
    assert 0.90 < np.mean(hits) < 0.99


# --- What holds for a part of the data alone ---------------------------------------------------------


def join(first: Log, second: Log) -> Log:
    """Return the first log's torque for two thirds of the time, the second's for the rest."""
    early = np.arange(len(first)) < 2 * len(first) / 3
    return replace(first, tau=np.where(early[:, None], first.tau, second.tau))


def test_refit_that_is_worse_than_the_urdf_is_not_explained() -> None:
    """A hand pushed slowly in the training part alone."""
    log = take()
    push = np.sin(1.3 * log.t) + np.sin(2.9 * log.t + 1.0)
    tau = log.tau + 0.45 * np.std(log.tau, axis=0) * np.outer(push, [0.0, 1.0])
    found = identify(RIG, [join(replace(log, tau=tau), log)], filtering=EXACT)
    fits = [one.fit_percent["tilt"] for one in (found.held_out, found.simpler[0])]
    assert 50 < fits[0] < 90 < 95 < fits[1]
    assert found.opinions == {"pan": Opinion.EXPLAINED, "tilt": Opinion.NOT_EXPLAINED}


def test_effect_of_one_part_alone_is_left_out_or_doubted_by_tuning(tmp_path: Path) -> None:
    """Teeth that the training part or the held-out part has; the file of the model keeps the doubt."""
    teeth = [Cogging("tilt", (7.0,))]
    early, late, whole = (
        identify(RIG, [log], teeth, filtering=EXACT)
        for log in (join(take(0.05), take()), join(take(), take(0.05)), take(0.05))
    )
    assert early.warnings[0].startswith("tilt: cogging left out: ")
    assert not any("cos_7" in name for name in early.names)
    assert any("cos_7" in name for name in whole.names)
    write_model(late, tmp_path / "model.yaml")
    tuning = tune(read_model(tmp_path / "model.yaml", RIG))
    assert tuning.warnings == late.warnings[:1]
    assert "tilt: not to be run" in tuning.doubts[-1]
    assert not whole.model.doubts and not tune(whole.model).doubts


# --- Logs beside each other --------------------------------------------------------------------------


def rub(tilt: float) -> Rig:
    """Return the rig with the tilt joint's friction times a factor."""
    return replace(RIG, friction=RIG.friction * np.array([[1.0], [tilt]]))


def record_each(rigs: Sequence[Rig], seed: int = 0) -> list[Log]:
    """Return a log of each rig with a motion and noise of its own."""
    return [record(rig, 10 * seed + k) for k, rig in enumerate(rigs)]


def compare(logs: Sequence[Log]) -> Agreement:
    """Return how far the logs of a rig agree."""
    found = identify(RIG, logs, filtering=EXACT, examined="noisy").agreement
    assert found is not None
    assert found.logs == tuple(log.name for log in logs)
    return found


def test_logs_of_one_rig_agree_as_often_as_chance_has_it() -> None:
    each = [compare(record_each([RIG] * 3, seed)) for seed in range(8)]
    assert not any(one.drifting for one in each)
    p_values = np.array([x.p_value for one in each for x in one.parameters])
    expected = 0.01 * len(p_values)
    assert np.sum(p_values < 0.01) <= expected + 3 * np.sqrt(expected)
    assert 0.3 < np.mean(p_values) < 0.7


def test_what_differs_from_log_to_log_drifts_alone_in_any_order() -> None:
    """Friction of one joint, or a camera that was moved."""
    worn = compare(record_each([RIG, RIG, rub(1.6)]))
    assert {one.name for one in worn.drifting} == {"tilt.Fs", "tilt.Fv"}
    logs = record_each([RIG, RIG, PayloadShift(0.02, 0.0, 0.0).apply(RIG)])
    found = compare(logs)
    assert found.drifting
    assert not any(one.name.endswith((".Fs", ".Fv")) for one in found.drifting)
    for x, y in zip(found.parameters, compare(logs[::-1]).parameters, strict=True):
        np.testing.assert_allclose((x.values, x.std), (y.values[::-1], y.std[::-1]), rtol=1e-6)
        assert x.verdict is y.verdict


def test_difference_that_moves_no_torque_is_no_drift() -> None:
    """Friction a thousandth greater is significant without noise, and immaterial."""
    rigs = [RIG, RIG, rub(1.001)]
    logs = [prescribed(nominal(rig), k, 10.0, 1e-5, 4e-3) for k, rig in enumerate(rigs)]
    found = compare(logs)
    assert min(one.p_value for one in found.parameters) < 0.01 / len(found.parameters)
    assert not found.drifting


@pytest.mark.parametrize(
    ("second", "noise", "is_swapped"),
    [("cinema", 0.02, False), ("cinema", 0.0, False), ("zoom-lens", 0.02, True)],
)
def test_payload_swapped_within_a_log_is_suspected(
    second: str, noise: float, is_swapped: bool
) -> None:
    """No encoder that drifts by half a milliradian is, which moves no torque, be it far beyond the noise."""
    rigs = [bundled("turret", payload) for payload in ("cinema", second)]
    before, after = (prescribed(nominal(one), 1, 12.0, noise, 2e-3) for one in rigs)
    tau = np.where(before.t[:, None] < 6.0, before.tau, after.tau)
    drifting = before.q + 1e-4 * (before.t[:, None] - 6.0)
    log = replace(before, q=drifting, tau=tau)
    found = identify(rigs[0], [log], filtering=EXACT, examined="noisy")
    assert found.parting is not None
    assert found.is_of_two_rigs == is_swapped
    assert found.parting > 2.0 if is_swapped else 0.0 < found.parting < 0.5


def test_log_counts_once_whatever_its_name(tmp_path: Path) -> None:
    """Twice in one call, or beside a model that was identified from it."""
    first, other = record_each([RIG, RIG])
    copy = replace(first, name="copy")
    once, twice = (
        identify(RIG, logs, filtering=EXACT, holdout="none") for logs in ([first], [first, copy])
    )
    np.testing.assert_array_equal(once.estimate.covariance, twice.estimate.covariance)
    assert len(twice.logs) == 1
    write_model(once, tmp_path / "once.yaml")
    known = read_known(tmp_path / "once.yaml", RIG)
    with pytest.raises(UsageError, match=r"copy.*twice"):
        identify_new(RIG, [copy], known, filtering=EXACT)
    identify_new(RIG, [other], known, filtering=EXACT)
