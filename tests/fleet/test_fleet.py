"""Laws of fleets: a fault planted in a unit is reported of it, in which parameter and since when, and of no other.

One table, whatever the manifest's format; what is computed is not computed again; what cannot be used is a line.
"""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from gimbal_pin import Log, Rig, compare_fleet, nominal, write_log
from gimbal_pin.dynamics import Model, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.fleet import (
    DeviationKind,
    Fleet,
    Reason,
    Vary,
    Verdict,
    draw_rigs,
    make_variation,
    read_manifest,
)
from gimbal_pin.fleet.variation import Variation
from tests.bench_logs import fourier, prescribed
from tests.command_line import Run, refused, result
from tests.rigs import bundled, chain

RIG = bundled("turret")
MONTHS = ("2026-03-01", "2026-04-01", "2026-05-01", "2026-06-01")
TOLERANCES = Vary(
    inertials=("normal", 0.0, 0.02), friction=("normal", 0.0, 0.1), payload={"mass": 0.0}
)
"""Differences between units of one build."""


@cache
def variation() -> Variation:
    """Return how units of the turret differ."""
    return make_variation(nominal(RIG), TOLERANCES)


def record(file: Path, unit: int, seed: int = 0, joint: str = "", viscous: float = 1.0) -> None:
    """Write the log of a unit of the turret, with its own tolerances and noise, all in one motion."""
    motion = fourier(RIG, 1, 6.5, dt=2.5e-3)
    drawn = draw_rigs(variation().inputs, 30)[unit]
    mass = 0.6 * (file.stem == "heavy")
    values = {**variation().choose_values(drawn.probabilities), "payload.mass": mass}
    plant = stiffen(variation().make_body(values), joint, viscous)
    tau = plant.inverse(motion.q, motion.v, motion.a)
    noise = np.random.default_rng([unit, seed]).standard_normal(tau.shape)
    tau += 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * noise
    write_log(Log(file.stem, RIG.joints, motion.t, motion.q, motion.v, tau), file)


def stiffen(model: Model, joint: str, factor: float) -> Model:
    """Return the model with so many times the viscous friction at a joint."""
    terms = [
        replace(term, values=tuple(factor * x for x in term.values))
        if (term.effect.name, term.effect.joint) == ("viscous", joint)
        else term
        for term in model.terms
    ]
    return replace(model, terms=tuple(terms))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight like units, one with thick grease, one with a heavy camera, one broken log, one that wears out."""
    out = tmp_path_factory.mktemp("fleet")
    entries = []
    for k in range(8):
        record(out / f"A{k}.csv", k)
        entries.append({"log": f"A{k}.csv", "unit": f"00{k}", "time": MONTHS[0]})
    record(out / "thick.csv", 8, joint="tilt", viscous=3.0)
    record(out / "heavy.csv", 9)
    (out / "broken.csv").write_text((out / "A0.csv").read_text()[:3000])
    entries += [{"log": f"{name}.csv", "time": MONTHS[0]} for name in ("thick", "heavy", "broken")]
    for k, (month, factor) in enumerate(zip(MONTHS, (1.0, 1.5, 2.0, 2.5))):
        record(out / f"worn{k}.csv", 10, seed=k, joint="pan", viscous=factor)
        entries.append({"log": f"worn{k}.csv", "unit": "worn", "time": month})
    (out / "manifest.yaml").write_text(json.dumps({"rig": "turret", "logs": entries}))
    return out


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tmp_path_factory.mktemp("results") / "out")


def compare(logs: Path, **options: Any) -> Fleet:
    """Compare in this process."""
    with ThreadPoolExecutor(1) as pool:
        return compare_fleet(logs, executor=pool, **options)


@pytest.fixture(scope="module")
def fleet(folder: Path, results: str) -> Fleet:
    return compare(folder, folder=results, quick=True)


def list_verdicts(fleet: Fleet) -> dict[str, tuple[Verdict, tuple[Reason, ...]]]:
    return {one.unit: (one.verdict, one.reasons) for one in fleet.units}


def test_odd_units_are_named_with_parameter_and_time(fleet: Fleet) -> None:
    odd = (Verdict.FAIL, (Reason.ODD_PARAMETER,))
    planted = {"thick": odd, "heavy": odd, "worn": odd, "broken": (Verdict.RETEST, (Reason.DATA,))}
    assert list_verdicts(fleet) == {f"00{k}": (Verdict.PASS, ()) for k in range(8)} | planted
    found = {one.unit: {own.parameter: own for own in one.deviations} for one in fleet.units}
    thick = found["thick"].pop("tilt.Fv")
    worn = found["worn"].pop("pan.Fv")
    assert found["thick"] == found["worn"] == {}
    assert {"head_mount.mx", "head_mount.mz"} <= set(found["heavy"])
    assert thick.shift == pytest.approx(2 * 0.008, abs=0.006)
    assert (thick.kind, thick.since) == (DeviationKind.OFFSET, None)
    assert worn.shift > 0.006
    assert worn.kind is not DeviationKind.OFFSET
    assert worn.since in (None, *MONTHS[1:])
    assert (fleet.failed, len(fleet.table)) == (1, 15)
    population = fleet.population
    assert abs(population["mean"]["tilt.Fs"] - 0.04) < 4 * population["mean_std"]["tilt.Fs"]


def test_the_same_call_computes_nothing_again(
    run: Run, fleet: Fleet, folder: Path, results: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gimbal_pin.fleet.fleet.identify", None)
    found = result(run, "fleet", folder, "--quick", "--workers", 1, "-o", results)
    assert found == json.loads(json.dumps(fleet.to_dict()))
    assert "thick" in (Path(results) / "report.html").read_text()
    refused(run("fleet", folder, "-o", results), 2, "another run's results: other quick")


def test_one_log_is_compared_with_an_earlier_fleet(
    run: Run, fleet: Fleet, results: str, tmp_path: Path
) -> None:
    record(tmp_path / "good.csv", 20)
    record(tmp_path / "001.csv", 21, joint="pan", viscous=3.0)
    call = ["fleet", tmp_path, "--rig", "turret", "--quick", "--workers", 1]
    found = result(run, *call, "--reference", results, "-o", tmp_path / "out")
    verdicts = {one["unit"]: one["verdict"] for one in found["units"]}
    assert verdicts == {"good": "pass", "001": "fail"}
    assert [own["parameter"] for own in found["units"][0]["deviations"]] == ["pan.Fv"]
    (tmp_path / "001.csv").unlink()
    call += ["-o", tmp_path / "new"]
    refused(run(*call), 2, "has the logs of one unit", "--reference")
    refused(run(*call, "--reference", tmp_path), 2, "is no result of a fleet")
    other = (*call, "--payload", "zoom-lens", "--reference", results)
    refused(run(*other), 2, "has the payload infrared", "zoom-lens")


def test_a_cause_of_one_unit_alone_fails_it_since_its_first_log_with_it(tmp_path: Path) -> None:
    rig = chain(1)
    cogging = parse_effect("cogging:joint0:amplitude=0.03,harmonic=14", rig)
    plants = [nominal(rig)] * 3 + [plant_with(nominal(rig), [cogging]).plant]
    entries = []
    for k, (unit, month, plant) in enumerate(zip("ABCC", (0, 0, 0, 1), plants)):
        log = prescribed(plant, seconds=8.0, torque_noise=0.01 + 1e-4 * k, dt=5e-3)
        write_log(log, tmp_path / f"{k}.csv")
        entries.append({"log": f"{k}.csv", "unit": unit, "time": MONTHS[month]})
    (tmp_path / "manifest.yaml").write_text(json.dumps({"logs": entries}))
    found = compare(tmp_path, rig=rig)
    (own,) = next(one for one in found.units if one.unit == "C").causes
    verdicts = list_verdicts(found)
    assert Reason.OWN_CAUSE in verdicts["C"][1]
    assert [verdicts[unit][0] for unit in "AB"] == [Verdict.PASS] * 2
    assert (own.cause, own.joint, own.status, own.since) == (
        "cogging",
        "joint0",
        "named",
        MONTHS[1],
    )
    assert [(one.cause, one.units, one.of) for one in found.causes] == [("cogging", 1, 3)]


def test_a_stated_rotor_inertia_is_a_known_part_of_every_unit(tmp_path: Path) -> None:
    """The inertia of the joint without the rotor is estimated, as `identify` does."""
    stated = "urdf: turret\nmotors:\n  pan: {rotor_inertia: 0.01}\n"
    (tmp_path / "rotor.yaml").write_text(stated)
    rig = Rig.load(tmp_path / "rotor.yaml")
    for k in range(3):
        log = prescribed(nominal(rig), seed=k, seconds=6.5, torque_noise=0.01, dt=5e-3)
        write_log(log, tmp_path / f"{k}.csv")
    found = compare(tmp_path, rig=rig, quick=True)
    assert list_verdicts(found) == {f"{k}": (Verdict.PASS, ()) for k in range(3)}
    expected = rig.phi[[9, 19]].sum()
    mean = found.population["mean"]["yoke.Izz + head_mount.Izz"]
    assert mean == pytest.approx(expected, rel=0.05)


def manifest(folder: Path, stated: dict[str, Any]) -> Path:
    """Write a manifest, and an empty file for each log that it names."""
    for entry in stated["logs"]:
        (folder / entry["log"]).touch()
    (folder / "manifest.yaml").write_text(json.dumps(stated))
    return folder


def test_blanks_at_the_ends_of_a_units_name_make_no_other_unit(tmp_path: Path) -> None:
    names = ("U0", "U0 ", " U0", "U 0", "ß")
    logs = [{"log": f"{k}.csv", "unit": name} for k, name in enumerate(names)]
    found = read_manifest(manifest(tmp_path, {"rig": "turret", "logs": logs}))
    assert len({log.unit for log in found.logs}) == 3


def test_manifests_in_yaml_parquet_and_csv_are_one(folder: Path, tmp_path: Path) -> None:
    stated = json.loads((folder / "manifest.yaml").read_text())
    rows = pd.DataFrame([{**entry, "rig": "turret", "cutoff": 5.0} for entry in stated["logs"]])
    found = [replace(read_manifest(manifest(tmp_path, {**stated, "cutoff": 5})), place="")]
    (tmp_path / "manifest.yaml").unlink()
    for write, name in ((partial(rows.to_csv, index=False), "csv"), (rows.to_parquet, "parquet")):
        write(tmp_path / f"manifest.{name}")
        found.append(replace(read_manifest(tmp_path), place=""))
        (tmp_path / f"manifest.{name}").unlink()
    assert found[0] == found[1] == found[2]
    assert (found[0].is_dated, found[0].cutoff, found[0].logs[0].unit) == (True, 5.0, "000")


A = {"log": "a.csv"}
B = {"log": "b.csv"}


@pytest.mark.parametrize(
    ("stated", "place"),
    [
        ({"logs": [A, {"log": "c.csv"}]}, "logs[1]: is "),
        ({"logs": [A, B, {"log": "./a.csv"}]}, "logs[2]: is ./a.csv"),
        ({"logs": [A, {**B, "serial": "7"}]}, "logs[1]: has an unknown key 'serial'"),
        ({"logs": [A, B], "rig": "nowhere.urdf"}, "rig: is "),
        ({"logs": [A, B]}, "names no rig"),
        ({"logs": [{**A, "time": "May"}, B]}, "logs[0].time: is 'May'"),
        ({"logs": [{**A, "time": 1}, {**B, "time": "2026-01-01"}]}, "logs[1]: has a date"),
        ({"logs": []}, "names no logs"),
        ({"logs": [{**A, "unit": "É"}, {**B, "unit": "é "}], "rig": "turret"}, "logs[1]"),
    ],
)
def test_a_bad_manifest_is_one_line(
    run: Run, tmp_path: Path, stated: dict[str, Any], place: str
) -> None:
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).touch()
    (tmp_path / "manifest.yaml").write_text(json.dumps(stated))
    refused(run("fleet", tmp_path, "-o", tmp_path / "out"), 2, place)
    assert not (tmp_path / "out").exists()


def test_folders_and_logs_that_cannot_be_used_are_one_line(run: Run, tmp_path: Path) -> None:
    call = ["fleet", tmp_path, "-o", tmp_path / "out", "--workers", 1]
    refused(run("fleet", tmp_path / "none", *call[2:]), 2, "none: is no folder")
    refused(run(*call), 2, "names no logs")
    (tmp_path / "manifest.csv").write_text("log,rig\na.csv,turret\nb.csv,thesis\n")
    refused(run(*call), 2, "states the rig turret and thesis")
    (tmp_path / "manifest.csv").unlink()
    for name in "ab":
        (tmp_path / f"{name}.csv").write_text("t,q_pan\n0,1\n")
    refused(run(*call, "--rig", "turret"), 3, "has no log that can be used: ")
    assert len(pd.read_parquet(tmp_path / "out" / "results.parquet")) == 2
