"""Identification: what is planted comes back, with honest deviations, and nothing that cannot be seen is claimed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.checks import check_log
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.effects import Cogging, LoadDependentFriction, Term, TorqueTable
from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.identification import (
    ESTIMATORS,
    compare_payload,
    describe_omitted_effects,
    given_beta,
    identify,
    refittable_effects,
    split_logs,
)
from gimbal_pin.log import Log
from gimbal_pin.regression import (
    Filtering,
)
from gimbal_pin.report import show_parameters, show_torque
from gimbal_pin.rig import Rig
from tests.bench_logs import closed_loop, fourier, oracle, prescribed
from tests.checks.corruption import CORRUPTIONS

EXACT = Filtering(alignment=0.0)


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def clean(turret: Rig) -> Log:
    return prescribed(nominal(turret), seconds=20.0)


def planted(rig: Rig) -> np.ndarray:
    return np.concatenate([given_beta(rig, reduce_parameters(rig)), rig.friction.ravel()])


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_a_log_without_noise_gives_the_parameters_back(name: str) -> None:
    rig = Rig.load(name)
    found = identify(rig, [prescribed(nominal(rig), seconds=15.0)], filtering=EXACT)
    scale = np.abs(planted(rig)).max()
    assert np.abs(found.estimate.theta - planted(rig)).max() < 1e-6 * scale
    np.testing.assert_allclose(found.stated, planted(rig), atol=1e-9 * scale)
    assert min(found.held_out.fit_percent.values()) > 99.8
    assert found.physical


@pytest.mark.parametrize(
    ("estimator", "off"), [("weighted", 1e-8), ("physical", 1e-6), ("output-error", 1e-4)]
)
def test_a_rotor_that_the_rig_states_is_known_and_stays_in_the_model(
    turret: Rig, estimator: str, off: float
) -> None:
    motors = tuple(replace(motor, gear_ratio=6.0, rotor_inertia=2e-4) for motor in turret.motors)
    geared = replace(turret, motors=motors)
    log = prescribed(nominal(geared), 1, seconds=8.0, dt=2e-3)
    found = identify(geared, [log], estimator=ESTIMATORS[estimator], filtering=EXACT)
    np.testing.assert_allclose(found.estimate.theta, planted(geared), atol=off)
    np.testing.assert_allclose(found.model.rig.armature, 0.0072)
    assert not found.model.armature.any()


def test_swings_to_and_fro_keep_their_turns(turret: Rig) -> None:
    """A swing faster than a second turns every few periods of the filter; there it accelerates most."""
    w = 2 * np.pi * np.array([1.1, 1.4])
    t = 1e-3 * np.arange(15000)[:, None]
    q = 0.3 * np.sin(w * t)
    v = 0.3 * w * np.cos(w * t)
    a = -0.3 * w**2 * np.sin(w * t)
    tau = nominal(turret).inverse(q, v, a)
    tau += 0.01 * np.std(tau, axis=0) * np.random.default_rng(0).standard_normal(tau.shape)
    found = identify(turret, [Log("swings", turret.joints, t[:, 0], q, v, tau)], filtering=EXACT)
    assert min(found.train.used.values()) > 0.6
    assert min(found.held_out.fit_percent.values()) > 99.0


def test_angles_drowned_in_noise_are_not_called_a_lack_of_motion() -> None:
    rig = Rig.load("turret")
    log = prescribed(nominal(rig), 1, 12.0)
    q = log.q + 0.05 * np.random.default_rng(0).standard_normal(log.q.shape)
    with pytest.raises(DataError, match=r"rate's noise.*finer angles"):
        identify(rig, [replace(log, q=q, v=None)])


def test_estimators_agree_without_noise(turret: Rig) -> None:
    """Output error integrates a torque whose jumps lie between its samples, and so sees them a sample off."""
    log = prescribed(nominal(turret), seconds=12.0)
    found = {
        name: identify(turret, [log], estimator=each, filtering=EXACT)
        for name, each in ESTIMATORS.items()
    }
    first = found["ols"].estimate.theta
    for name, other in found.items():
        near = 1e-3 if name == "output-error" else 1e-4
        assert np.abs(first - other.estimate.theta).max() < near * np.abs(first).max(), name
        assert other.estimate.method == name


def test_lost_samples_and_jitter_do_not_move_the_parameters(turret: Rig, clean: Log) -> None:
    rng = np.random.default_rng(2)
    keep = np.sort(rng.permutation(len(clean))[: int(0.97 * len(clean))])
    keep = keep[(keep < 4000) | (keep > 4600)]
    holed = Log("holed", clean.joints, clean.t[keep], clean.q[keep], clean.v[keep], clean.tau[keep])
    found = identify(turret, [holed], filtering=EXACT).estimate.theta
    assert np.abs(found - planted(turret)).max() < 2e-3 * np.abs(planted(turret)).max()


def test_deviations_are_honest(turret: Rig) -> None:
    """Over 8 noise seeds the errors in standard deviations are standard normal in size."""
    z = []
    for seed in range(8):
        log = prescribed(nominal(turret), seed=seed, seconds=20.0, torque_noise=0.02, dt=0.004)
        found = identify(turret, [log], filtering=EXACT, holdout="none").estimate
        z.append((found.theta - planted(turret)) / found.std)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert np.abs(z).max() < 4.5


def test_sensor_noise_costs_little() -> None:
    """1 % torque noise, 16-bit encoders, the rig's gyros; `scripts/accuracy` does this for all rigs and 20 seeds."""
    rig = Rig.load("thesis", "zoom-lens")
    log, tau = closed_loop(rig, seed=1, seconds=12.0)
    found = identify(rig, [log])
    error = np.abs(found.estimate.theta - planted(rig))
    assert np.all(error < 4 * found.estimate.std)
    sharp = found.estimate.std < 0.012 * np.abs(planted(rig))
    assert sharp.sum() > 5 and np.all(error[sharp] < 0.05 * np.abs(planted(rig))[sharp])
    best = oracle(rig, log, tau)
    for joint, left in found.held_out.torque_rmse.items():
        assert left < 1.5 * best.held_out.torque_rmse[joint]


def test_a_joint_that_never_moved_is_refused_by_name(turret: Rig) -> None:
    motion = fourier(turret, 0, 10.0)
    still = [x * [1.0, 0.0] for x in (motion.q, motion.v, motion.a)]
    tau = nominal(turret).inverse(*still)
    with pytest.raises(DataError) as caught:
        identify(turret, [Log("still", turret.joints, motion.t, still[0], still[1], tau)])
    assert "tilt.Fs" in caught.value.unseen and "tilt.Fv" in caught.value.unseen
    assert caught.value.exit_code == 3 and "\n" not in str(caught.value)


@pytest.mark.parametrize("samples", [2, 10, 300])
def test_too_few_samples_are_refused(turret: Rig, clean: Log, samples: int) -> None:
    with pytest.raises(DataError) as caught:
        identify(turret, [clean.part(slice(0, samples))])
    assert caught.value.unseen and caught.value.exit_code == 3
    names = caught.value.unseen
    assert ", ".join(names[:6]) in str(caught.value) and (
        f"and {len(names) - 6} more" in str(caught.value)
    ) == (len(names) > 6)


def test_a_log_without_torque_is_refused(turret: Rig, clean: Log) -> None:
    with pytest.raises(UsageError, match="tau_<joint>"):
        identify(turret, [replace(clean, tau=None)])


def test_holding_out(clean: Log) -> None:
    train, test, how = split_logs([clean], None, EXACT)
    assert how == "last third" and len(train[0]) + len(test[0]) == len(clean)
    assert abs(len(train[0]) / len(clean) - 2 / 3) < 1e-3 and test[0].t[0] > train[0].t[-1]
    assert split_logs([clean] * 3, None, EXACT)[2] == "log 3 of 3"
    assert split_logs([clean] * 3, "log:1", EXACT)[2] == "log 1 of 3"
    assert split_logs([clean], "none", EXACT)[1] == ()
    for wrong in ("log:4", "log:0", "half"):
        with pytest.raises(UsageError):
            split_logs([clean] * 3, wrong, EXACT)


def test_no_table_is_wider_than_a_terminal() -> None:
    """Every line that is laid out in columns fits 120; what a result prints is lines, not arrays."""
    rig = Rig.load("thesis")
    found = identify(rig, [prescribed(nominal(rig), 1, 10.0, torque_noise=0.02, dt=4e-3)])
    told = [
        *show_parameters(found, compare_payload(found)).to_text().splitlines(),
        *show_torque(found).to_text().splitlines(),
    ]
    tables = [line for line in told if "   " in line.strip() or line.startswith("body ")]
    assert len(tables) > len(found.names) and max(map(len, tables)) <= 120
    short = str(found)
    assert (
        f"{len(found.names)} parameters by weighted" in short
        and "array(" not in short
        and short.count("\n") == 3
    )
    assert found.held_out is not None and all(
        f"{joint} " in str(found.held_out) for joint in rig.joints
    )


def test_what_is_wrong_with_the_logs_and_the_parameters_is_said_first(turret: Rig) -> None:
    log = prescribed(nominal(turret), torque_noise=0.01, dt=2e-3)
    assert identify(turret, [log], examined="noisy").warnings == ()
    bad = CORRUPTIONS["controller-formula"](log, np.random.default_rng(0))
    found = identify(turret, [bad], examined="noisy")
    assert "controller's formula" in found.warnings[0]
    assert found.warnings[0].endswith(check_log(turret, bad).faults[0].next_experiment)
    assert (
        show_parameters(found, compare_payload(found))
        .to_text()
        .startswith(f"Warning\n  {found.warnings[0]}\n")
    )
    assert found.to_dict()["warnings"] == list(found.warnings)
    assert not identify(turret, [bad], examined="never").faults


def test_every_effect_of_an_extended_model_is_fitted_again_or_said_not_to_be(turret: Rig) -> None:
    fitted = Term(Cogging("pan", (7.0,)), (0.05, 0.0))
    loaded = Term(LoadDependentFriction("pan"), (0.1,))
    table = Term(TorqueTable("tilt", "angle", (0.0, 1.0)), (0.1, 0.2))
    plain = nominal(turret)
    model = replace(plain, terms=(*plain.terms, fitted, loaded, table))
    assert refittable_effects(model) == (fitted.effect,)
    (said,) = describe_omitted_effects(model)
    assert "load-dependent-friction of pan, torque-table of tilt" in said and "cogging" not in said
    assert describe_omitted_effects(replace(plain, terms=(*plain.terms, fitted))) == ()


def test_figures_that_cannot_be_are_said(turret: Rig) -> None:
    driven = replace(turret, friction=-turret.friction)
    found = identify(turret, [prescribed(nominal(driven), torque_noise=0.01, dt=2e-3)])
    names = [name for name in found.names if name.endswith((".Fs", ".Fv"))]
    assert [said.split(" ")[0] for said in found.warnings] == names and all(
        "negative" in s for s in found.warnings
    )
    assert found.held_out is not None
    worse = replace(found.held_out, fit_percent=dict.fromkeys(turret.joints, -3.0))
    dull = replace(found.train, used=dict.fromkeys(turret.joints, 0.4))
    vague = replace(found.estimate, covariance=1e6 * found.estimate.covariance)
    said = "\n".join(
        replace(found, held_out=worse, train=dull, estimate=vague, trust=10.0).warnings
    )
    assert "negative" not in said
    for joint in turret.joints:
        assert f"{joint}: the model predicts the held-out torque worse" in said
        assert f"{joint}: 60 % of the samples" in said


def test_a_sum_of_inertias_under_zero_is_said(turret: Rig) -> None:
    log = prescribed(nominal(turret), torque_noise=0.01, dt=2e-3)
    base = reduce_parameters(turret)
    sums = [
        k
        for k, terms in enumerate(base.terms)
        if all(x > 0 and ".I" in name for name, x in terms.items())
    ]
    found = identify(turret, [log])
    theta = found.estimate.theta.copy()
    theta[sums] *= -1
    under = replace(found, estimate=replace(found.estimate, theta=theta))
    positive = [k for k in sums if base.base_names[k].split(".")[1][:3] in ("Ixx", "Iyy", "Izz")]
    assert [said.split(" is negative")[0] for said in under.warnings] == [
        found.names[k] for k in positive
    ]
    assert positive
