"""Without variation all rigs are one, planted influences are found, and figures are those of the table."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import degrees, pi
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from gimbal_pin import identify, monte_carlo, nominal, track, tune
from gimbal_pin.dynamics import reduce_parameters
from gimbal_pin.fleet import MonteCarlo, Vary, draw_rigs, make_variation, rank_influences
from gimbal_pin.identification import given_beta
from tests.bench_logs import prescribed
from tests.command_line import Run, refused, result
from tests.rigs import bundled

TURRET = bundled("turret")
NOTHING = Vary(parameters=0.0)
LATE = Vary(inertials=("normal", 0.0, 0.001), delay=("uniform", 0.0, 0.004))


def study(count: int = 8, vary: Vary = LATE, **options: Any) -> MonteCarlo:
    """Simulate the step and little more in this process."""
    with ThreadPoolExecutor(1) as pool:
        return monte_carlo(TURRET, count=count, vary=vary, seconds=0.65, executor=pool, **options)


def test_without_variation_every_rig_is_the_nominal_one() -> None:
    """A controller tuned anew for each is the same."""
    found = study(2, NOTHING)
    model = nominal(TURRET)
    law = tune(model).controller
    for draw, row in zip(draw_rigs((), 2), found.table.to_dict("records")):
        noise = np.random.default_rng([draw.seed, 2])
        alone = track(model, {"own": law}, rng=noise, seconds=0.65, one_by_one=False)
        for joint, own in alone.experiments[0].joints.items():
            assert row[f"rms_error_{joint}"] == own.rms_error
    assert found.inputs == ()
    assert found.failed == 0
    assert found.sensitivity.empty
    pd.testing.assert_frame_equal(found.table, study(2, NOTHING, retune=True).table)


def test_a_rig_that_cannot_exist_is_a_row_with_its_inputs_and_its_error() -> None:
    vary = Vary(payload={"mass": ("uniform", -2.0, 0.3)})
    found = study(vary=vary, spec=["rms_error < 90"])
    impossible = found.table["payload.mass"] < -1
    assert 0 < impossible.sum() == found.failed < 8
    assert found.table["error"][impossible].str.contains("mass").all()
    told = found.to_dict()
    assert told["yield"]["value"] == 1 - found.failed / 8
    worst = told["worst"][0]
    assert worst["error"]
    assert worst["rms_error"] is None


def test_the_yield_is_the_share_with_wilsons_interval() -> None:
    """The dominant input ranks first, the worst rigs are those of its largest values."""
    late = study()
    ranks = late.sensitivity["rank_correlation"]
    assert ranks.index[0] == "delay"
    assert ranks.iloc[0] > 0.9 > 0.8 > abs(ranks.iloc[1])
    rows = late.table.sort_values("rms_error")
    assert [row["unit"] for row in late.worst] == rows["unit"].tolist()[::-1]
    assert late.worst[0]["delay"] > 0.003
    errors = rows["rms_error"].to_numpy()
    bound = degrees((errors[5] + errors[6]) / 2)
    found = study(spec=[f"rms_error < {bound!r} °", "peak_torque < 1.5"])
    low, middle, high = np.quantile(errors, [0.05, 0.5, 0.95], method="nearest")
    assert found.figures.loc["rms_error"].tolist() == [middle, low, high, errors[-1]]
    low, high = binomtest(6, 8).proportion_ci(0.95, "wilson")
    expected = {"value": 6 / 8, "low": low, "high": high, "of": 8}
    assert found.to_dict()["yield"] == pytest.approx(expected, abs=1e-6)


def test_sobol_indices_of_ishigamis_function() -> None:
    """``sin a + 7 sin² b + 0.1 c⁴ sin a`` on ±π: Ishigami and Homma, 1990; a rig that failed is left out."""
    inputs = ("a", "b", "c")
    rigs = draw_rigs(inputs, 2048, seed=3, sobol=True)
    a, b, c = (2 * pi * np.array([rig.probabilities for rig in rigs]) - pi).T
    used = np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)
    used[7] = np.inf
    found = rank_influences(inputs, rigs, used, sobol=True)
    assert list(found.index) == ["a", "b", "c"]
    np.testing.assert_allclose(found["first"], [0.3139, 0.4424, 0.0], atol=0.05)
    np.testing.assert_allclose(found["total"], [0.5576, 0.4424, 0.2437], atol=0.05)
    assert (found["first_confidence"] < 0.15).all()


def test_parameters_are_drawn_from_the_covariance() -> None:
    """Changes by one deviation of each input square to it, each most in its own parameter."""
    log = prescribed(nominal(TURRET), seconds=6.0, torque_noise=0.02, dt=4e-3)
    model = identify(TURRET, [log], holdout="none").model
    assert model.estimated is not None
    variation = make_variation(model, Vary())
    reduction = reduce_parameters(TURRET)
    middle = dict.fromkeys(variation.distributions, 0.0)
    bodies = [variation.make_body({**middle, name: 1.0}) for name in variation.inputs]
    changes = np.array([given_beta(body.rig, reduction) for body in bodies])
    changes -= given_beta(model.rig, reduction)
    count = changes.shape[1]
    covariance = model.estimated.covariance[:count, :count]
    shares = changes / np.sqrt(np.diag(covariance))
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    np.testing.assert_allclose(shares.T @ shares, correlation, atol=1e-6)
    np.testing.assert_allclose(shares[:count], shares[:count].T, atol=1e-6)


def test_a_payload_is_off_by_millimetres_and_a_share_of_its_mass() -> None:
    variation = make_variation(nominal(TURRET), Vary(payload={"x": 0.0, "mass": 0.0}))
    middle = dict.fromkeys(variation.distributions, 0.0)
    moved = variation.make_body({**middle, "payload.x": 2.0}).rig.phi - TURRET.phi
    doubled = variation.make_body({**middle, "payload.mass": 1.0}).rig.phi - TURRET.phi
    assert np.linalg.norm(moved[11:14]) == pytest.approx(2e-3 * doubled[10])


# --- The verb -----------------------------------------------------------------------------------


def test_a_platform_and_planted_causes_from_the_command_line(run: Run, tmp_path: Path) -> None:
    """The seed chooses the rigs; of a run that is too short no drift is stated."""
    (tmp_path / "vary.yaml").write_text(
        "effects:\n  cogging:pan: {amplitude: [uniform, 0.01, 0.05], harmonic: 14}\n"
        "payload: {x: [normal, 0, 1]}"
    )
    options = ["--platform", "S", "--vary", tmp_path / "vary.yaml", "--spec", "jitter < 1"]
    call = ["montecarlo", "turret", "--count", 2, "--workers", 1, "--seed", 3, *options]
    found = result(run, *call, "--seconds", 4.6, "-o", tmp_path / "out")
    assert found["yield"]["value"] == 1.0
    table = pd.read_parquet(tmp_path / "out" / "results.parquet")
    drawn = [rig.probabilities[1] for rig in draw_rigs(("x", "amplitude"), 2, seed=3)]
    np.testing.assert_allclose(table["cogging:pan.amplitude"], 0.01 + 0.04 * np.array(drawn))
    assert table["jitter"].gt(0).all()
    assert found["figures"]["drift"]["median"] is None
    refused(run(*call, "--seconds", 0.6, "-o", tmp_path / "new"), 2, "--seconds", "0.6 s")


@pytest.mark.parametrize(
    ("options", "vary", "said"),
    [
        ("", "delay: [normal, 0, -1]", "vary.yaml: delay: is ['normal', 0, -1]"),
        ("", "effects: {cogging:pan: {amplitude: 0.1}}", "vary.yaml: effect 'cogging:pan"),
        ("", "delays: 1", "unknown key 'delays'"),
        ("", "effects: {rust:pan: {amount: 1}}", "there is no cause 'rust'"),
        ("--spec jitter<1", "{}", "no figure"),
        ("--spec rms_error<1kg", "{}", "number of °"),
        ("--sobol", "delay: [uniform, 0, 0.001]", "--count: is 3, the base of a Sobol"),
    ],
)
def test_what_cannot_be_varied_or_asked_is_one_line(
    options: str, vary: str, said: str, run: Run, tmp_path: Path
) -> None:
    path = tmp_path / "vary.yaml"
    path.write_text(vary)
    call = ["montecarlo", "turret", "--count", 3, "--vary", path, *options.split()]
    refused(run(*call, "-o", tmp_path / "out"), 2, said)
    assert not (tmp_path / "out").exists()
