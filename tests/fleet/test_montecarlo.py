"""Laws of Monte Carlo studies: where nothing varies nothing differs, what is planted is found, one table for all."""

from __future__ import annotations

import sys
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from math import degrees, pi, sqrt
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gimbal_pin import Rig, identify, monte_carlo, nominal, track, tune
from gimbal_pin.dynamics import reduce_parameters
from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import MonteCarlo, RigDesign, Variation, Vary, process_pool, rank_influences
from gimbal_pin.fleet.variation import factor_covariance
from gimbal_pin.identification import given_beta
from tests.bench_logs import prescribed
from tests.command_line import Run, refused, result
from tests.fleet.stub import LastFirst
from tests.rigs import BODY, spelled

SHORT = 0.65
"""Length of a run, s: the step and little more."""
NOTHING = Vary(parameters=0.0, own_noise=False)
"""All rigs are the nominal one."""
LATE = Vary(inertials=("normal", 0.0, 0.001), delay=("uniform", 0.0, 0.004), own_noise=False)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def late(rig: Rig) -> MonteCarlo:
    return monte_carlo(rig, count=8, vary=LATE, seconds=SHORT, workers=1)


def test_without_variation_every_rig_is_the_nominal_one(rig: Rig) -> None:
    found = monte_carlo(rig, count=3, vary=NOTHING, seconds=SHORT, workers=1)
    model = nominal(rig)
    noise = np.random.default_rng([int(RigDesign((), 3, own_noise=False)[0].seed), 2])
    step = track(model, {"own": tune(model).controller}, rng=noise, seconds=SHORT, one_by_one=False).experiments[0]
    for joint, own in step.joints.items():
        assert set(found.table[f"rms_error_{joint}"]) == {own.rms_error}
        assert set(found.table[f"overshoot_percent_{joint}"]) == {own.overshoot_percent}
    assert found.inputs == () and found.failed == 0 and found.sensitivity.empty
    assert repr(found).startswith("MonteCarlo(rig='turret'") and len(found.table) == 3


def test_what_dominates_ranks_first_and_the_worst_are_its_largest(late: MonteCarlo) -> None:
    ranks = late.sensitivity["rank_correlation"]
    assert ranks.index[0] == "delay" and ranks.iloc[0] > 0.95 and abs(ranks.iloc[1]) < 0.7
    most = late.table.sort_values("rms_error", ascending=False).unit.tolist()
    assert [row["unit"] for row in late.worst] == most and late.worst[0]["delay"] > 0.003


def test_sobol_indices_of_ishigamis_function() -> None:
    """``sin a + 7 sin² b + 0.1 c⁴ sin a`` on ±π: Ishigami and Homma, 1990."""
    design = RigDesign(("a", "b", "c"), 1024, seed=3, sobol=True)
    a, b, c = (2 * pi * np.array([unit.shares for unit in design]) - pi).T
    found = rank_influences(design, np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a))
    assert list(found.index) == ["a", "b", "c"] and len(design) == 1024 * 5
    np.testing.assert_allclose(found["first"], [0.3139, 0.4424, 0.0], atol=0.03)
    np.testing.assert_allclose(found["total"], [0.5576, 0.4424, 0.2437], atol=0.03)
    assert (found["first_confidence"] < 0.1).all()


@pytest.mark.parametrize("kind", ["threads", "last first", "processes"])
def test_the_table_is_the_same_to_the_bit_whatever_runs_it(
    rig: Rig, late: MonteCarlo, tmp_path: Path, kind: str
) -> None:
    makers = {"threads": lambda: ThreadPoolExecutor(2), "last first": LastFirst, "processes": lambda: process_pool(2)}
    other = monte_carlo(
        rig, count=8, vary=LATE, seconds=SHORT, workers=1, executor=makers[kind], folder=tmp_path / "out"
    )
    pd.testing.assert_frame_equal(late.table, other.table, check_exact=True)
    again = monte_carlo(rig, count=8, vary=LATE, seconds=SHORT, executor=Executor, folder=str(tmp_path / "out"))
    pd.testing.assert_frame_equal(again.table, other.table, check_exact=True)


def test_the_yield_is_the_share_that_meets_all_with_wilsons_interval(rig: Rig, tmp_path: Path) -> None:
    own = partial(monte_carlo, rig, count=8, vary=LATE, seconds=SHORT, workers=1, folder=str(tmp_path / "out"))
    errors = np.sort(own().table.rms_error)
    bound = degrees(float(errors[5] + errors[6]) / 2)
    found = own(spec=[f"rms_error < {bound!r} deg", "peak_torque < 1.5"])
    z, share = 1.959964, 6 / 8
    middle, half = share + z**2 / 16, z * sqrt(share * (1 - share) / 8 + z**2 / 4 / 8**2)
    assert found.yield_ is not None and (found.yield_.value, found.yield_.of) == (share, 8)
    assert np.allclose([found.yield_.low, found.yield_.high], (middle + np.array([-half, half])) / (1 + z**2 / 8))
    assert own(spec=[f"rms_error < {float(np.radians(bound))!r} rad", "peak_torque < 1e-6"]).yield_.value == 0.0
    assert found.figures["worst"]["rms_error"] == errors[-1]
    with pytest.raises(UsageError, match="another run's results: `seed` differs"):
        own(seed=1)


def test_a_rig_that_cannot_be_is_a_row_with_its_inputs_and_its_error(rig: Rig) -> None:
    vary = Vary(payload={"mass": ("uniform", -2.0, 0.3)}, own_noise=False)
    found = monte_carlo(rig, count=8, vary=vary, seconds=SHORT, spec=["rms_error < 90"], workers=1)
    impossible = found.table["payload.mass"] < -1
    assert 0 < impossible.sum() == found.failed < 8
    assert found.table.error[impossible].str.contains("mass").all() and found.table.error[~impossible].isna().all()
    assert found.yield_.value == 1 - found.failed / 8
    assert found.worst[0]["error"] and found.to_dict()["worst"][0]["rms_error"] is None


def test_noise_of_torque_encoder_and_gyro_each_shows(rig: Rig) -> None:
    def error(**noise: float) -> float:
        vary = Vary(own_noise=False, **noise)
        return float(monte_carlo(rig, count=1, vary=vary, seconds=SHORT, workers=1).table.rms_error[0])

    still = error(gyro_noise=0.0, encoder_step=0.0)
    for noise in ({"torque_noise": 0.3}, {"encoder_step": 0.01}, {"gyro_noise": 0.01}):
        assert error(**{"gyro_noise": 0.0, "encoder_step": 0.0, **noise}) > 1.5 * still


def test_parameters_are_drawn_from_the_covariance(rig: Rig) -> None:
    model = identify(rig, [prescribed(nominal(rig), seconds=10.0, torque_noise=0.02)], holdout="none").model
    known, variation = model.estimated, Variation(model, Vary())
    L = factor_covariance(known.covariance)
    assert np.allclose(L @ L.T, known.covariance, rtol=1e-9, atol=1e-12 * np.abs(known.covariance).max())
    reduction = reduce_parameters(rig)
    count = len(reduction.base_names)
    assert variation.inputs == tuple(f"parameters.{name}" for name in known.names)
    for k in (0, count - 1):
        off = dict.fromkeys(variation.inputs, 0.0) | {variation.inputs[k]: 2.0}
        body = variation.make_body({**variation.values([0.5] * len(known.names)), **off})
        change = given_beta(body.rig, reduction) - given_beta(model.rig, reduction)
        assert np.allclose(change, 2 * L[:count, k], rtol=1e-6, atol=1e-9)


def test_a_platform_and_planted_causes_from_the_command_line(run: Run, tmp_path: Path) -> None:
    vary, out = tmp_path / "vary.yaml", tmp_path / "out"
    vary.write_text(
        "effects:\n  cogging:pan: {amplitude: [uniform, 0.01, 0.05], harmonic: 14}\npayload: {x: [normal, 0, 1]}"
    )
    call = ["montecarlo", "turret", "--count", 2, "--seconds", 4.6, "--platform", "S", "--vary", vary, "-o", out]
    call += ["--spec", "jitter < 1", "--workers", 1]
    found = result(run, *call)
    assert (found["rig"], found["count"], found["failed"]) == ("turret", 2, 0)
    assert found["yield"]["value"] == 1.0 and found["specification"] == ["jitter < 1"]
    assert found["figures"]["jitter"].keys() == {"median", "p5", "p95", "worst"}
    assert {own["input"] for own in found["sensitivity"]} == {"cogging:pan.amplitude", "payload.x"}
    assert len(found["worst"]) == 2 and "jitter" in (out / "report.html").read_text()
    table = pd.read_parquet(out / "results.parquet")
    assert table["cogging:pan.amplitude"].between(0.01, 0.05).all() and table.jitter.gt(0).all()
    code, said, _ = run(*call)
    assert code == 0 and "100.0 % meet jitter < 1" in said
    assert next(line for line in said.splitlines() if line.startswith("drift")).split()[2:] == ["–"] * 4
    assert found["figures"]["drift"]["median"] is None


@pytest.mark.parametrize(("seconds", "spec"), [(0.6, "jitter < 1"), (4.5, "peak_torque < 1"), (6.9, "drift < 1")])
def test_a_run_too_short_for_its_figure_is_refused(run: Run, tmp_path: Path, seconds: float, spec: str) -> None:
    call = ["montecarlo", "turret", "--count", 1, "--platform", "S", "--seconds", seconds, "--spec", spec]
    refused(run(*call, "-o", tmp_path / "out"), 2, "--seconds", f"{seconds:g} s")


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ("delay: [uniform, 1]", "vary.yaml: delay: is ['uniform', 1]; write a number, [uniform"),
        ("delay: [gamma, 1, 2]", "vary.yaml: delay"),
        ("delay: [normal, 0, -1]", "vary.yaml: delay: is ['normal', 0, -1], whose deviation is negative"),
        ("delay: [uniform, 0, 0.9]", "vary.yaml: delay: is ['uniform', 0, 0.9]: time is"),
        (
            "effects: {cogging:pan: {amplitude: 0.1}}",
            "vary.yaml: effects: cogging:pan: is {'amplitude': 0.1}: ",
        ),
        ("delays: 1", "unknown key 'delays'"),
        ("payload: {w: 1}", "knows no 'w'"),
        ("effects: {rust:pan: {amount: 1}}", "there is no cause 'rust'"),
        ("effects: {cogging:pan: {amplitude: 0.1, teeth: 14}}", "no parameter 'teeth'"),
        ("[1, 2]", "is not a table"),
    ],
)
def test_a_bad_file_of_variations_is_one_line(run: Run, tmp_path: Path, vary: str, words: str) -> None:
    path = tmp_path / "vary.yaml"
    path.write_text(vary)
    refused(run("montecarlo", "turret", "--count", 2, "--vary", path, "-o", tmp_path / "out"), 2, words)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("rms_error", "states no positive number of °"),
        ("jitter < 1", "is no figure of these runs"),
        ("rms_error > 1", "is no figure of these runs"),
        ("rms_error <= 1", "compares by <=; write <"),
        ("rms_error < nan", "states no positive number of °"),
        ("rms_error < 1 kg", "states no positive number of °"),
        ("settling_time < -1", "states no positive number of s"),
    ],
)
def test_a_bad_specification_is_one_line(run: Run, tmp_path: Path, spec: str, words: str) -> None:
    call = ["montecarlo", "turret", "--count", 2, "--spec", spec, "-o", tmp_path / "out"]
    refused(run(*call), 2, f"--spec '{spec}'", words)


def test_sobol_asks_for_a_power_of_two_and_for_something_that_varies(run: Run, tmp_path: Path) -> None:
    call = ["montecarlo", "turret", "--sobol", "-o", tmp_path / "out"]
    refused(run(*call, "--count", 3), 2, "--count: is 3", "give 2 or 4")
    (tmp_path / "vary.yaml").write_text("delay: 0")
    refused(run(*call, "--count", 4, "--vary", tmp_path / "vary.yaml"), 2, "--sobol: has nothing that varies")


def test_a_missing_package_is_one_line(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    call = ["montecarlo", "turret", "--count", 2, "--seconds", 0.6, "-o", tmp_path / "out"]
    refused(run(*call), 2, "needs pyarrow, which is not installed; pip install gimbal-pin[fleet]")


def test_a_joint_that_slides_has_millimetres_and_no_share_in_the_angles() -> None:
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/>{4}</joint>'
    limit = '<limit lower="-1" upper="1" effort="90" velocity="9"/>'
    joints = joint.format("turn", "revolute", "base", "a", limit) + joint.format("slide", "prismatic", "a", "b", limit)
    rig = spelled(f'<robot name="mixed"><link name="base"/>{BODY.format("a", 2)}{BODY.format("b", 1)}{joints}</robot>')
    found = monte_carlo(rig, count=1, vary=NOTHING, seconds=SHORT, workers=1)
    assert (found.units["rms_error_turn"], found.units["rms_error_slide"]) == ("°", "mm")
    assert "rms_error" not in found.table and found.figures["worst"]["overshoot_percent"] >= 0
    assert found.failed == 0


def test_a_folder_of_other_files_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    call = ["montecarlo", "turret", "--count", 1, "--seconds", 0.6, "--workers", 1, "-o", tmp_path]
    refused(run(*call), 2, "holds report.html, which is of no run")
    refused(run(*call[:-1], ""), 2, "has no name")
    assert (tmp_path / "report.html").read_text() == "mine"
