"""Laws of what a model misses: noise is none of it, and where something is missed the deviations hold it."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from gimbal_pin.control import tune
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal, plant_with, reduce_parameters
from gimbal_pin.effects import Cogging, parse_effect
from gimbal_pin.errors import LogError
from gimbal_pin.identification import (
    Opinion,
    compare_payload,
    given_beta,
    identify,
    read_model,
    write_extended,
    write_model,
)
from gimbal_pin.log import Array, Log, write_log
from gimbal_pin.regression import (
    GROUPS,
    Block,
    add_misfit,
    build_discrepancy_columns,
    compute_blocks,
    find_likeliest_bodies,
    fit_misfit,
    fit_weighted,
    measure_pure_error,
    propagate_misfit,
)
from gimbal_pin.report import show_controller, show_parameters, show_torque
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, fourier, prescribed, rows_of
from tests.command_line import Run, result


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret")


def test_a_torque_in_another_unit_is_refused_with_the_map_that_mends_it() -> None:
    rig = Rig.load("drone")
    log = prescribed(nominal(rig), 1, 6.0, dt=4e-3)
    loud = replace(log, tau=2000.0 * rig.tau_max * log.tau / np.abs(log.tau).max(axis=0))  # type: ignore[operator]
    with pytest.raises(
        LogError,
        match=r"tau_yaw.*times the motor's 4.5 N m.*--map 'tau_yaw=tau_yaw\*0.001'.* from mN m, times KT from mA",
    ):
        identify(rig, [loud])


def test_what_no_log_determines_stays_near_the_urdf(turret: Rig) -> None:
    """A value as vague as can be leaves the URDF's bodies as they are; a sharp one moves them all the way."""
    rig = turret
    mixing = rows_of(turret, prescribed(nominal(turret), 1, 4.0, dt=4e-3)).mixing
    beta = mixing @ rig.phi
    vague = find_likeliest_bodies(
        rig.phi, mixing, 1.5 * beta, np.diag((100 * beta + 1.0) ** 2), 0.3
    )
    sharp = find_likeliest_bodies(
        rig.phi, mixing, 1.2 * beta, np.diag((1e-4 * np.abs(beta) + 1e-9) ** 2), 0.3
    )
    assert np.allclose(vague, rig.phi, rtol=0.01, atol=1e-4)
    assert np.allclose(mixing @ sharp, 1.2 * beta, rtol=2e-3, atol=1e-6)


def test_an_inertia_just_under_zero_is_undetermined(turret: Rig) -> None:
    found = identify(
        turret, [prescribed(nominal(turret), 1, 20.0, torque_noise=0.01, dt=4e-3)], filtering=EXACT
    )
    k = found.names.index("tilt.Fv")
    theta = found.estimate.theta.copy()
    theta[k] = -1.5 * found.estimate.std[k]
    said = replace(found, estimate=replace(found.estimate, theta=theta)).warnings
    assert any(one.startswith("undetermined") and "tilt.Fv (-" in one for one in said)
    assert not any(one.startswith("undetermined") for one in found.warnings)


def rippling(log: Log, size: float) -> Log:
    """The log with a ripple of 14 per turn at its first joint, as a share of that joint's torque."""
    tau = np.array(log.tau)
    tau[:, 0] += size * np.std(tau[:, 0]) * np.sin(14 * log.q[:, 0] + 0.7)
    return replace(log, tau=tau)


def deviations_off(rig: Rig, log: Log) -> tuple[Array, Array]:
    """Errors in deviations without and with what the model misses."""
    blocks = compute_blocks(rows_of(rig, log))
    plain = fit_weighted(blocks)
    held, _ = add_misfit(blocks, plain)
    assert np.array_equal(held.theta, plain.theta)
    true = np.concatenate([given_beta(rig, reduce_parameters(rig)), rig.friction.ravel()])
    return (plain.theta - true) / plain.std, (plain.theta - true) / held.std


def test_a_ripple_that_the_model_lacks_is_held_by_the_deviations(turret: Rig) -> None:
    logs = [
        prescribed(nominal(turret), seed, 20.0, torque_noise=0.01, dt=4e-3) for seed in range(2)
    ]
    off = [deviations_off(turret, rippling(log, 1.0)) for log in logs]
    without, held = (np.array(x) for x in zip(*off))
    assert np.sqrt(np.mean(held**2)) < min(1.25, np.sqrt(np.mean(without**2)))


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_nothing_that_the_model_misses(seed: int) -> None:
    """White noise beside columns of any kind; what is a function of them is found to its size."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((600, 5))
    X = rng.standard_normal((600, len(GROUPS)))
    noise = rng.standard_normal(600)
    assert fit_misfit(A, X, A.sum(axis=1) + noise, 600.0).size < 0.25
    missed = 2.0 * X[:, GROUPS == 1] @ rng.standard_normal(int(np.sum(GROUPS == 1)))
    found = fit_misfit(A, X, A.sum(axis=1) + missed + noise, 600.0)
    assert found.size == pytest.approx(np.std(missed), rel=0.15) and found.noise == pytest.approx(
        1.0, rel=0.15
    )


def test_what_comes_back_with_the_motion_is_no_noise() -> None:
    """Any function of the motion drops out of five periods exactly, and noise of any size remains, joint by joint."""
    rng = np.random.default_rng(0)
    rows = 5 * 80
    phase = np.tile(2 * np.pi * np.arange(80) / 80, 5)[:, None] + np.array([0.0, 1.0])
    q = np.sin(phase) + 0.3 * np.cos(2 * phase)
    v = np.cos(phase) - 0.6 * np.sin(2 * phase)
    size = np.array([0.1, 3.0])
    lacking = np.tanh(9 * v) + np.cos(14 * q)
    none = np.zeros((rows, 2))
    block = Block(np.arange(rows) / 8, np.zeros((rows, 2, 0)), lacking, q, v, none + 1, none, none)
    assert measure_pure_error([block], np.zeros(0)).max() < 1e-9
    noisy = block._replace(b=lacking + size * rng.standard_normal((rows, 2)))
    assert measure_pure_error([noisy], np.zeros(0)) == pytest.approx(size, rel=0.12)
    halves = [Block(*(x[at] for x in noisy)) for at in (slice(0, 200), slice(200, None))]
    assert measure_pure_error(halves, np.zeros(0)) == pytest.approx(size, rel=0.12)
    assert np.isinf(measure_pure_error([Block(*(x[:9] for x in noisy))], np.zeros(0))).all()


def test_a_spring_that_passes_for_gravity_is_held_by_its_deviations() -> None:
    """A joint turns by 30° to 60° either way against gravity, friction and a spring; over draws, most are held."""
    rng = np.random.default_rng(0)
    held = list[bool]()
    t = np.linspace(0.0, 10.0, 1000)[:, None]
    for _ in range(60):
        size = rng.normal(size=5) / np.arange(1, 6)
        phase = rng.uniform(0, 2 * np.pi, 5)
        turning = np.sin(0.86 * np.arange(1, 6) * t + phase) @ size
        q = rng.uniform(0.5, 1.0) * turning / np.abs(turning).max() + rng.uniform(-0.5, 0.5)
        v = np.gradient(q, t[:, 0])
        A = np.column_stack([np.sin(q), np.cos(q), np.sign(v), v])
        X = build_discrepancy_columns(q, v)
        b = np.tanh(3 * (q - q.mean())) + 0.01 * rng.standard_normal(len(q))
        gain = np.linalg.inv(A.T @ A)
        root = propagate_misfit(gain, A.T @ X, fit_misfit(A, X, b, 1000.0))
        std = np.sqrt(np.sum(root**2, axis=1) + 0.01**2 * np.diag(gain))
        held += (np.abs(gain @ A.T @ b) < 1.96 * std)[:2].tolist()
    assert np.mean(held) > 0.85


def test_a_joint_that_is_not_explained_is_said_first(turret: Rig) -> None:
    log = prescribed(nominal(turret), 1, 20.0, torque_noise=0.01, dt=4e-3)
    found = identify(turret, [rippling(log, 1.0)], filtering=EXACT)
    first = found.warnings[0]
    fit = found.held_out.fit_percent["pan"]
    assert (
        first.startswith("pan is not explained: ") and "gimbal-pin diagnose" in first and fit < 90
    )
    assert (
        show_parameters(found, compare_payload(found)).to_text().startswith(f"Warning\n  {first}\n")
    )
    assert not any(said.startswith("tilt is not explained") for said in found.warnings)
    assert not any(
        "not explained" in said for said in identify(turret, [log], filtering=EXACT).warnings
    )
    assert found.opinions == {"pan": Opinion.NOT_EXPLAINED, "tilt": Opinion.EXPLAINED}
    assert found.to_dict()["misfit"]["pan"]["opinion"] == "not explained"
    told = show_torque(found).to_text()
    assert "not explained" in told and " explained" in told.replace("not explained", "")
    assert (
        found.to_dict()["misfit"]["pan"]["torque_rms"]
        > 10 * found.to_dict()["misfit"]["tilt"]["torque_rms"]
    )


def test_a_small_ripple_is_structure_and_none_is_explained_whatever_the_noise(turret: Rig) -> None:
    """A tenth of the torque is a matter of accuracy; noise of a third of it is noise."""
    clean, noisy = (
        prescribed(nominal(turret), 1, 20.0, torque_noise=size, dt=4e-3) for size in (1e-3, 0.1)
    )
    some = identify(turret, [rippling(clean, 0.05)], filtering=EXACT).opinions
    assert some == {"pan": Opinion.STRUCTURE_LEFT, "tilt": Opinion.EXPLAINED}
    assert set(identify(turret, [noisy], filtering=EXACT).opinions.values()) == {Opinion.EXPLAINED}


def test_the_urdf_has_the_bodies_of_the_extended_model(
    run: Run, tmp_path: Path, turret: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the cogging that was found in the equations they are nearer to the truth, by either verb and as MJCF."""
    log = tmp_path / "log.csv"
    folder = tmp_path / "found"
    teeth = parse_effect("cogging:pan:amplitude=0.05,harmonic=7", turret)
    write_log(
        prescribed(plant_with(nominal(turret), [teeth]).plant, 3, 8.0, torque_noise=0.01, dt=4e-3),
        log,
    )
    urdfs = [tmp_path / f"{name}.urdf" for name in ("plain", "diagnosed", "extended")]
    still = ("--alignment", "0")
    monkeypatch.setattr(
        "gimbal_pin.diagnosis.diagnose", partial(diagnose, causes={"cogging": Cogging})
    )
    assert run("identify", "turret", log, "--urdf", urdfs[0], *still)[0] == 0
    urdfs.append(tmp_path / "diagnosed.xml")
    code, _, told = run(
        "diagnose", "turret", log, "-o", folder, "--urdf", urdfs[1], "--mjcf", urdfs[3], *still
    )
    assert code == 0 and "not in MuJoCo's model: pan: cogging" in told
    assert (
        run(
            "identify",
            "turret",
            log,
            "--extended",
            folder / "extended.yaml",
            "--urdf",
            urdfs[2],
            *still,
        )[0]
        == 0
    )
    known = reduce_parameters(turret)
    off = [
        np.linalg.norm(given_beta(Rig.load(urdf), known) - given_beta(turret, known))
        for urdf in urdfs
    ]
    assert off[1] < 0.5 * off[0] and off[2:] == pytest.approx([off[1]] * 2, rel=1e-6)


# --- What holds for nothing but what was fitted -------------------------------------------------------------------


def halves(first: Log, second: Log) -> Log:
    """The first log's torque for two thirds of the time, the second's for the rest."""
    early = np.arange(len(first.t)) < 2 * len(first.t) / 3
    return replace(first, tau=np.where(early[:, None], first.tau, second.tau))


@pytest.fixture(scope="module")
def toothed(turret: Rig) -> tuple[Log, Log]:
    """A motion without teeth and the same with them, whose torque is half of tilt's."""
    smooth = nominal(turret)
    teeth = parse_effect("cogging:tilt:amplitude=0.05,harmonic=7", turret)
    plants = (smooth, plant_with(smooth, [teeth]).plant)
    without, with_ = (prescribed(plant, 1, 20.0, torque_noise=0.01, dt=4e-3) for plant in plants)
    return without, with_


TEETH = (Cogging("tilt", (7.0,)),)


def test_an_effect_of_the_training_part_alone_is_left_out_and_said_first(
    turret: Rig, tmp_path: Path, run: Run
) -> None:
    """As cogging that a narrow motion seems to show and a wide one does not: its fit says 99.9 %, and 74 % there."""
    logs = [swept(turret, seed, size) for seed, size in ((1, 0.3), (2, 1.0))]
    files = [tmp_path / f"{log.name}.csv" for log in logs]
    for log, file in zip(logs, files):
        write_log(log, file)
    extended = tmp_path / "extended.yaml"
    model = tmp_path / "model.yaml"
    teeth = [Cogging("tilt", (4.0, 7.0))]
    write_extended(identify(turret, logs, teeth, filtering=EXACT, holdout="none").model, extended)
    found = result(
        run, "identify", "turret", *files, "--extended", extended, "--alignment", 0, "-o", model
    )
    first = found["warnings"][0]
    fit = found["held_out"]["fit_percent"]["tilt"]
    said = r"tilt: cogging left out: .* training part to 99.* %, the held-out part to [67].* %; without it to 9[89]"
    assert (
        re.match(said, first)
        and fit > 98
        and not any("cos_7" in x["name"] for x in found["base_parameters"])
    )
    assert "effective_rows" in found["train"]
    tuned = result(run, "tune", "turret", model, "--plants", 1)
    assert tuned["warnings"] == [first] and not any(
        "beyond the data" in doubt for doubt in tuned["doubts"]
    )


def swept(rig: Rig, seed: int, size: float) -> Log:
    """A log of a motion of so much of its usual size, with its noise."""
    motion = fourier(rig, seed, 12.0, 4e-3)
    model = nominal(rig)
    q = motion.q.mean(axis=0) + size * (motion.q - motion.q.mean(axis=0))
    tau = model.inverse(q, size * motion.v, size * motion.a)
    tau += 0.01 * np.std(tau, axis=0) * np.random.default_rng(seed).standard_normal(tau.shape)
    return Log(f"swept {seed}", rig.joints, motion.t, q, size * motion.v, tau)


def test_an_effect_that_holds_is_kept(turret: Rig, toothed: tuple[Log, Log]) -> None:
    for effects, log in ((TEETH, toothed[1]), (TEETH, toothed[0]), ((), toothed[0])):
        found = identify(turret, [log], effects, filtering=EXACT)
        assert not found.model.doubts and [t.effect for t in found.model.terms[4:]] == list(effects)


def test_a_model_that_holds_for_its_training_part_alone_is_refused_for_control(
    turret: Rig, toothed: tuple[Log, Log], tmp_path: Path
) -> None:
    """Teeth that only the held-out part has; an older file says nothing of it, and is tuned as it was."""
    found = identify(turret, [halves(*toothed)], TEETH, filtering=EXACT)
    assert re.match(
        r"tilt: the model fits its training part to 99.*, the held-out part to", found.warnings[0]
    )
    write_model(found, path := tmp_path / "model.yaml")
    tuning = tune(read_model(path, turret))
    assert tuning.wish.dt == pytest.approx(toothed[0].dt)
    assert tuning.warnings == found.warnings[:1] and "tilt: not to be run" in tuning.doubts[-1]
    assert (
        show_controller(tuning)
        .to_text()
        .startswith(f"Warning\n  {found.warnings[0]}\n  tilt: not to be run")
    )
    older = {key: x for key, x in yaml.safe_load(path.read_text()).items() if key != "doubts"}
    path.write_text(yaml.safe_dump(older))
    assert not tune(read_model(path, turret)).doubts
