"""Laws of Monte Carlo studies: without variation all rigs are one, planted influences are found, one table for all."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import degrees, pi
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from gimbal_pin import Rig, identify, monte_carlo, nominal, track, tune
from gimbal_pin.dynamics import reduce_parameters
from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import MonteCarlo, Vary, draw_rigs, make_variation, rank_influences
from gimbal_pin.fleet.variation import factor_covariance
from gimbal_pin.identification import given_beta
from tests.bench_logs import prescribed
from tests.command_line import Run, refused, result
from tests.rigs import BODY, spelled

NOTHING = Vary(parameters=0.0)
LATE = Vary(inertials=("normal", 0.0, 0.001), delay=("uniform", 0.0, 0.004))


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


def study(rig: Rig, count: int = 8, vary: Vary = LATE, **options: Any) -> MonteCarlo:
    """Simulate the step and little more in this process."""
    with ThreadPoolExecutor(1) as pool:
        return monte_carlo(
            rig, **{"count": count, "vary": vary, "seconds": 0.65, "executor": pool, **options}
        )


@pytest.fixture(scope="module")
def late(rig: Rig) -> MonteCarlo:
    return study(rig)


def test_without_variation_every_rig_is_the_nominal_one(rig: Rig) -> None:
    found = study(rig, 2, NOTHING)
    model = nominal(rig)
    for draw, row in zip(draw_rigs((), 2), found.table.to_dict("records")):
        noise = np.random.default_rng([draw.seed, 2])
        step = track(
            model, {"own": tune(model).controller}, rng=noise, seconds=0.65, one_by_one=False
        ).experiments[0]
        assert [row[f"rms_error_{joint}"] for joint in rig.joints] == [
            own.rms_error for own in step.joints.values()
        ]
    assert found.inputs == () and found.failed == 0 and found.sensitivity.empty


def test_the_dominant_input_ranks_first_and_the_worst_are_its_largest(late: MonteCarlo) -> None:
    ranks = late.sensitivity["rank_correlation"]
    assert ranks.index[0] == "delay" and ranks.iloc[0] > 0.9 and abs(ranks.iloc[1]) < 0.8
    most = late.table.sort_values("rms_error", ascending=False)["unit"].tolist()
    assert [row["unit"] for row in late.worst] == most and late.worst[0]["delay"] > 0.003


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


def test_the_yield_is_the_share_with_wilsons_interval(
    rig: Rig, late: MonteCarlo, tmp_path: Path
) -> None:
    errors = np.sort(late.table["rms_error"])
    bound = degrees(float(errors[5] + errors[6]) / 2)
    found = study(
        rig, spec=[f"rms_error < {bound!r} °", "peak_torque < 1.5"], folder=tmp_path / "a"
    )
    low, middle, high = np.quantile(errors, [0.05, 0.5, 0.95], method="nearest")
    assert found.figures.loc["rms_error"].tolist() == [middle, low, high, errors[-1]]
    expected = binomtest(6, 8).proportion_ci(0.95, "wilson")
    assert found.yield_ is not None
    assert (found.yield_.value, found.yield_.of) == (6 / 8, 8)
    assert (found.yield_.low, found.yield_.high) == pytest.approx([*expected], abs=1e-6)
    none = study(rig, spec=["peak_torque < 1e-6"], folder=tmp_path / "a")
    assert none.yield_ is not None
    assert none.yield_.value == 0.0
    with pytest.raises(UsageError, match="another run's results: other seed"):
        study(rig, seed=1, folder=tmp_path / "a")


def test_a_rig_that_cannot_exist_is_a_row_with_its_inputs_and_its_error(rig: Rig) -> None:
    found = study(rig, vary=Vary(payload={"mass": ("uniform", -2.0, 0.3)}), spec=["rms_error < 90"])
    impossible = found.table["payload.mass"] < -1
    assert 0 < impossible.sum() == found.failed < 8
    assert found.table["error"][impossible].str.contains("mass").all()
    assert found.yield_ is not None and found.yield_.value == 1 - found.failed / 8
    assert found.worst[0]["error"] and found.to_dict()["worst"][0]["rms_error"] is None


def test_parameters_are_drawn_from_the_covariance(rig: Rig) -> None:
    model = identify(
        rig, [prescribed(nominal(rig), seconds=10.0, torque_noise=0.02)], holdout="none"
    ).model
    variation = make_variation(model, Vary())
    assert variation.estimated is not None
    covariance = variation.estimated.covariance
    names = variation.estimated.names
    root = factor_covariance(covariance)
    assert np.allclose(root @ root.T, covariance, rtol=1e-9, atol=1e-12 * np.abs(covariance).max())
    reduction = reduce_parameters(rig)
    count = len(reduction.base_names)
    assert variation.inputs == tuple(f"parameters.{name}" for name in names)
    for k in (0, count - 1):
        values = dict.fromkeys(variation.inputs, 0.0) | {variation.inputs[k]: 2.0}
        body = variation.make_body({**variation.choose_values([0.5] * len(names)), **values})
        change = given_beta(body.rig, reduction) - given_beta(model.rig, reduction)
        assert np.allclose(change, 2 * root[:count, k], rtol=1e-6, atol=1e-9)


def test_a_platform_and_planted_causes_from_the_command_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "vary.yaml").write_text(
        "effects:\n  cogging:pan: {amplitude: [uniform, 0.01, 0.05], harmonic: 14}\n"
        "payload: {x: [normal, 0, 1]}"
    )
    options = ["--platform", "S", "--vary", tmp_path / "vary.yaml", "--spec", "jitter < 1"]
    call = ["montecarlo", "turret", "--count", 2, "--workers", 1, *options]
    found = result(run, *call, "--seconds", 4.6, "-o", tmp_path / "out")
    assert (found["count"], found["failed"], found["yield"]["value"]) == (2, 0, 1.0)
    assert {own["input"] for own in found["sensitivity"]} == {"cogging:pan.amplitude", "payload.x"}
    table = pd.read_parquet(tmp_path / "out" / "results.parquet")
    assert table["cogging:pan.amplitude"].between(0.01, 0.05).all()
    assert table["jitter"].gt(0).all()
    assert found["figures"]["drift"]["median"] is None
    page = lxml.html.parse(str(tmp_path / "out" / "report.html"))
    (row,) = page.xpath("//tr[starts-with(., 'drift')]")
    assert {cell.text_content() for cell in row[1:]} == {"–"}
    refused(run(*call, "--seconds", 0.6, "-o", tmp_path / "new"), 2, "--seconds", "0.6 s")


def test_the_seed_chooses_the_rigs(run: Run, tmp_path: Path) -> None:
    call = ["montecarlo", "turret", "--count", 1, "--seconds", 0.6, "--workers", 1]
    figures = [
        result(run, *call, "--seed", seed, "-o", tmp_path / str(k))["figures"]
        for k, seed in enumerate((1, 1, 2))
    ]
    assert figures[0] == figures[1]
    assert figures[0] != figures[2]


@pytest.mark.parametrize(
    ("vary", "place"),
    [
        ("delay: [uniform, 1]", "vary.yaml: delay: is ['uniform', 1]"),
        ("delay: [normal, 0, -1]", "vary.yaml: delay: is ['normal', 0, -1]"),
        ("effects: {cogging:pan: {amplitude: 0.1}}", "vary.yaml: effect 'cogging:pan"),
        ("delays: 1", "unknown key 'delays'"),
        ("effects: {rust:pan: {amount: 1}}", "there is no cause 'rust'"),
        ("[1, 2]", "is not a table"),
    ],
)
def test_a_bad_file_of_variations_is_one_line(
    run: Run, tmp_path: Path, vary: str, place: str
) -> None:
    path = tmp_path / "vary.yaml"
    path.write_text(vary)
    refused(
        run("montecarlo", "turret", "--count", 2, "--vary", path, "-o", tmp_path / "out"), 2, place
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--spec", "rms_error"), ("--spec 'rms_error'", "number of °")),
        (("--spec", "jitter < 1"), ("no figure",)),
        (("--spec", "rms_error < 1 kg"), ("number of °",)),
        (("--sobol",), ("--count: is 3", "give 2 or 4")),
    ],
)
def test_options_that_cannot_be_are_one_line(
    run: Run, tmp_path: Path, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    call = ["montecarlo", "turret", "--count", 3, *options]
    refused(run(*call, "-o", tmp_path / "out"), 2, *words)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_other_files_is_left_as_it_is(run: Run, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    call = ["montecarlo", "turret", "--count", 1, "--seconds", 0.6, "--workers", 1, "-o"]
    refused(run(*call, tmp_path), 2, "holds report.html, which is of no run")
    assert (tmp_path / "report.html").read_text() == "mine"


def test_a_joint_that_slides_has_millimetres_and_no_share_in_the_angles() -> None:
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/>{4}</joint>'
    limit = '<limit lower="-1" upper="1" effort="90" velocity="9"/>'
    joints = joint.format("turn", "revolute", "base", "a", limit) + joint.format(
        "slide", "prismatic", "a", "b", limit
    )
    rig = spelled(
        f'<robot name="mixed"><link name="base"/>{BODY.format("a", 2)}{BODY.format("b", 1)}{joints}</robot>'
    )
    found = study(rig, 1, NOTHING)
    assert (found.units["rms_error_turn"], found.units["rms_error_slide"]) == ("°", "mm")
    assert "rms_error" not in found.table and found.figures["worst"]["overshoot_percent"] >= 0
