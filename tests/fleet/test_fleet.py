"""Laws of fleets: what is planted in a unit is found in it, in what and since when, and in no other."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pandas as pd
import pytest
from markupsafe import escape

from gimbal_pin import Log, Rig, compare_fleet, nominal, write_log
from gimbal_pin.dynamics import Model, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import DeviationKind, Fleet, Reason, RigDesign, Variation, Vary, Verdict, read_manifest
from tests.bench_logs import fourier
from tests.command_line import Run, refused, result
from tests.rigs import chain

MONTHS = ("2026-03-01", "2026-04-01", "2026-05-01", "2026-06-01")
TOLERANCES = Vary(inertials=("normal", 0.0, 0.02), friction=("normal", 0.0, 0.1), payload={"mass": 0.0})
"""What siblings differ by."""


@pytest.fixture(scope="module")
def record() -> Callable[..., None]:
    """Write the log of a unit of the turret, of its own tolerances and noise, all in one motion."""
    rig = Rig.load("turret")
    variation = Variation(nominal(rig), TOLERANCES)
    design, motion = RigDesign(variation.inputs, 100), fourier(rig, 1, 6.5, dt=2.5e-3)

    def write(file: Path, unit: int, seed: int = 0, mass: float = 0.0, joint: str = "", viscous: float = 1.0) -> None:
        values = variation.values(design[unit].shares)
        plant = stiffer(variation.make_body({**values, "payload.mass": mass}), joint, viscous)
        tau = plant.inverse(motion.q, motion.v, motion.a)
        noise = 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * np.random.default_rng([unit, seed]).standard_normal(tau.shape)
        write_log(Log(file.stem, rig.joints, motion.t, motion.q, motion.v, tau + noise), file)

    return write


def stiffer(model: Model, joint: str, factor: float) -> Model:
    """The model with so many times the viscous friction at a joint."""
    terms = (
        replace(term, values=tuple(factor * x for x in term.values))
        if (term.effect.name, term.effect.joint) == ("viscous", joint)
        else term
        for term in model.terms
    )
    return replace(model, terms=tuple(terms))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., None]) -> Path:
    """Eight like units, one with thick grease, one with a heavy camera, one broken log, one that wears out."""
    out = tmp_path_factory.mktemp("fleet")
    entries = []
    for k in range(8):
        record(out / f"A{k}.csv", k)
        entries.append({"log": f"A{k}.csv", "unit": f"00{k}", "time": MONTHS[0]})
    record(out / "thick.csv", 8, joint="tilt", viscous=3.0)
    record(out / "heavy.csv", 9, mass=0.6)
    (out / "broken.csv").write_text((out / "A0.csv").read_text()[:3000])
    entries += [{"log": f"{name}.csv", "time": MONTHS[0]} for name in ("thick", "heavy", "broken")]
    for k, (month, factor) in enumerate(zip(MONTHS, (1.0, 1.5, 2.0, 2.5))):
        record(out / f"worn{k}.csv", 10, seed=k, joint="pan", viscous=factor)
        entries.append({"log": f"worn{k}.csv", "unit": "worn", "time": month})
    (out / "manifest.yaml").write_text(json.dumps({"rig": "turret", "logs": entries}))
    return out


@pytest.fixture(scope="module")
def results(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tmp_path_factory.mktemp("results") / "out")


@pytest.fixture(scope="module")
def fleet(folder: Path, results: str) -> Fleet:
    return compare_fleet(folder, folder=results, quick=True, workers=1)


def verdicts(fleet: Fleet) -> dict[str, tuple[Verdict, tuple[Reason, ...]]]:
    return {one.unit: (one.verdict, one.reasons) for one in fleet.units}


def test_who_is_odd_in_what_and_since_when(fleet: Fleet) -> None:
    odd = (Verdict.FAIL, (Reason.ODD_PARAMETER,))
    planted = {"thick": odd, "heavy": odd, "worn": odd, "broken": (Verdict.RETEST, (Reason.DATA,))}
    assert verdicts(fleet) == {f"00{k}": (Verdict.PASS, ()) for k in range(8)} | planted
    found = {one.unit: {own.parameter: own for own in one.deviations} for one in fleet.units}
    assert set(found["thick"]) == {"tilt.Fv"} and set(found["worn"]) == {"pan.Fv"}
    thick = found["thick"]["tilt.Fv"]
    assert abs(thick.shift - 2 * 0.008) < 0.006 and thick.kind is DeviationKind.OFFSET
    assert {"head_mount.mx", "head_mount.mz"} <= set(found["heavy"]) <= {n for n in found["heavy"] if "head" in n}
    worn = found["worn"]["pan.Fv"]
    assert worn.kind is not DeviationKind.OFFSET and worn.shift > 0.006
    assert fleet.since(worn) in (None, *MONTHS[1:]) and fleet.since(thick) is None
    assert fleet.units[-1].verdict is Verdict.PASS and fleet.failed == 1
    assert "broken.csv:" in next(one for one in fleet.units if one.unit == "broken").errors[0]


def test_estimates_are_pooled_and_the_population_is_the_plants(fleet: Fleet) -> None:
    population = fleet.population
    assert abs(population["mean"]["tilt.Fs"] - 0.04) < 4 * population["mean_std"]["tilt.Fs"]
    frame = fleet.estimates
    assert frame.loc["thick", "tilt.Fv"] > 2 * population["mean"]["tilt.Fv"] and "broken" not in frame.index
    like = frame.loc[[f"00{k}" for k in range(8)], "tilt.Fv"]
    own = fleet.table.set_index("serial").loc[like.index, "value.tilt.Fv"]
    assert np.ptp(like) < np.ptp(own)
    assert repr(fleet).startswith("Fleet(rig='turret'") and len(fleet.table) == 15


def test_a_run_is_resumed_without_computing_anything(
    run: Run, fleet: Fleet, folder: Path, results: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gimbal_pin.fleet.fleet.identify_log", None)
    call = ["fleet", folder, "-o", results, "--quick", "--workers", 1]
    code, said, _ = run(*call, "--json", tmp_path / "fleet.json")
    assert code == 0 and "8 pass, 3 fail, 1 to be tested again" in said and "tilt.Fv" in said
    assert json.loads((tmp_path / "fleet.json").read_text()) == json.loads(json.dumps(fleet.to_dict()))
    shown = (Path(results) / "report.html").read_text()
    broken = next(one for one in fleet.units if one.unit == "broken")
    assert len(broken.errors[0]) > 72 and escape(broken.errors[0]) in shown
    assert "thick" in shown
    table = pd.read_parquet(f"{results}/results.parquet")
    assert table["value.tilt.Fv"].notna().sum() == 14 and table["error"].notna().sum() == 1
    refused(run(*call, "--seed", 1), 2, "holds another run's results: `seed` differs")


def test_one_short_log_is_judged_against_an_earlier_fleet(
    run: Run, fleet: Fleet, results: str, record: Callable[..., None], tmp_path: Path
) -> None:
    record(tmp_path / "good.csv", 20)
    record(tmp_path / "001.csv", 21, joint="pan", viscous=3.0)
    call = ["fleet", tmp_path, "--rig", "turret", "--quick", "--workers", 1]
    found = result(run, *call, "--reference", results, "-o", tmp_path / "out")
    assert {one["unit"]: one["verdict"] for one in found["units"]} == {"good": "pass", "001": "fail"}
    assert [own["parameter"] for own in found["units"][0]["deviations"]] == ["pan.Fv"]
    (tmp_path / "001.csv").unlink()
    refused(run(*call, "-o", tmp_path / "new"), 2, "has the logs of one unit", "--reference")
    refused(run(*call, "-o", tmp_path / "new", "--reference", tmp_path), 2, "--reference: ", "is no folder of an")
    call += ["--payload", "zoom-lens", "--reference", results]
    refused(run(*call, "-o", tmp_path / "new"), 2, "has the payload infrared, and these logs zoom-lens")


def write_cogging(file: Path, rig: Rig, seed: int, amplitude: float = 0.0) -> None:
    """Write the log of a unit of one joint, which cogs or does not."""
    motion = fourier(rig, 3, 8.0, dt=2.5e-3)
    cogging = parse_effect(f"cogging:joint0:amplitude={amplitude},harmonic=14", rig)
    plant = plant_with(nominal(rig), [cogging] * (amplitude > 0)).plant
    tau = plant.inverse(motion.q, motion.v, motion.a)
    tau += 0.01 * np.std(tau) * np.random.default_rng(seed).standard_normal(tau.shape)
    write_log(Log("cogs", rig.joints, motion.t, motion.q, motion.v, tau), file)


def test_a_cause_of_one_unit_alone_fails_it(tmp_path: Path) -> None:
    rig = chain(1)
    for k in range(3):
        write_cogging(tmp_path / f"{k}.csv", rig, k, 0.03 * (k == 2))
    found = compare_fleet(tmp_path, rig=rig, workers=1)
    assert Reason.OWN_CAUSE in verdicts(found)["2"][1]
    assert [asdict(own) for own in found.units[0].causes] == [
        {"cause": "cogging", "joint": "joint0", "status": "named", "since": None}
    ]
    assert [verdicts(found)[unit][0] for unit in "01"] == [Verdict.PASS] * 2
    assert [(one.cause, one.units, one.of) for one in found.causes] == [("cogging", 1, 3)]


def test_a_cause_began_with_the_first_log_that_has_it(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Planted is what `diagnose` says of each log: C is diagnosed without the cause before, D is not diagnosed."""
    cogging = json.dumps([{"cause": "cogging", "joint": "joint0", "status": "named"}])
    logs = [("A", 0, "[]"), ("B", 0, "[]"), ("C", 0, "[]"), ("C", 1, cogging), ("C", 2, cogging), ("D", 0, None)]
    logs.append(("D", 1, cogging))

    def diagnosed(log: Log, *others: object) -> dict[str, object]:
        findings = logs[int(Path(log.name).stem)][2]
        return {"verdict": findings and "ok", "findings": findings or "[]"}

    monkeypatch.setattr("gimbal_pin.fleet.fleet.diagnose_log", diagnosed)
    rig, out = chain(1), tmp_path / "out"
    (tmp_path / "chain.urdf").write_text(rig.urdf)
    entries = [{"log": f"{k}.csv", "unit": unit, "time": MONTHS[month]} for k, (unit, month, _) in enumerate(logs)]
    for k, entry in enumerate(entries):
        write_cogging(tmp_path / entry["log"], rig, k)
    manifest = tmp_path / "manifest.yaml"
    manifest.write_text(json.dumps({"rig": "chain.urdf", "logs": entries}))
    call = ["fleet", tmp_path, "--workers", 1]
    found = result(run, *call, "-o", out)
    causes = {one["unit"]: [(own["cause"], own["since"]) for own in one["causes"]] for one in found["units"]}
    assert causes == {"A": [], "B": [], "C": [("cogging", MONTHS[1])], "D": [("cogging", None)]}
    told = run(*call, "-o", out)[1].splitlines()
    shown = [line for line in told if "cogging at joint0" in line]
    assert len(shown) == 2 and all(line.endswith((MONTHS[1], "first log")) for line in shown)
    assert "Pass: A, B" in told and "Parameters over the fleet" in told
    assert "Pass: A, B" in (out / "report.html").read_text()
    manifest.write_text(json.dumps({"rig": "chain.urdf", "logs": entries[:1]}))
    _, said, _ = run(*call, "-o", tmp_path / "today", "--reference", out)
    assert "Parameters of the reference fleet" in said and "1 unit, 1 log, against" in said and "cogging" not in said


@pytest.mark.parametrize(
    ("names", "units"), [(("U0", "U0 ", " U0"), 1), (("U0", "U1", "U 0"), 3), (("ß", "ß", "U"), 2)]
)
def test_blanks_at_the_ends_of_a_units_name_make_no_other_unit(
    tmp_path: Path, names: tuple[str, ...], units: int
) -> None:
    for k in range(3):
        (tmp_path / f"{k}.csv").touch()
    stated = {"rig": "turret", "logs": [{"log": f"{k}.csv", "unit": name} for k, name in enumerate(names)]}
    (tmp_path / "manifest.yaml").write_text(json.dumps(stated))
    logs = read_manifest(tmp_path).logs
    assert len(logs) == 3 and len({log.unit for log in logs}) == units


@pytest.mark.parametrize("names", [("U0", "u0"), ("unit a", "Unit A "), ("É", "é")])
def test_units_that_differ_by_letter_case_alone_are_refused(run: Run, tmp_path: Path, names: tuple[str, str]) -> None:
    """Whether a manifest or files name them."""
    for name in names:
        (tmp_path / f"{name}.csv").touch()
    refused(run("fleet", tmp_path, "--rig", "turret", "-o", tmp_path / "out"), 2, *(name.strip() for name in names))
    stated = {"rig": "turret", "logs": [{"log": f"{name}.csv", "unit": name} for name in names]}
    (tmp_path / "manifest.yaml").write_text(json.dumps(stated))
    refused(run("fleet", tmp_path, "-o", tmp_path / "out"), 2, "logs[1]", *(name.strip() for name in names))


def test_manifests_in_yaml_parquet_and_csv_are_one(folder: Path, tmp_path: Path) -> None:
    stated = json.loads((folder / "manifest.yaml").read_text())
    rows = pd.DataFrame([{**entry, "rig": "turret", "cutoff": 5.0} for entry in stated["logs"]])
    (tmp_path / "map.yaml").write_text("tau_pan: tau_pan*1.0")
    rows["map"] = None
    rows.loc[0, "map"] = "map.yaml"
    for name in rows["log"]:
        (tmp_path / name).touch()
    found = []
    for write, name in ((rows.to_csv, "manifest.csv"), (rows.to_parquet, "manifest.parquet")):
        write(tmp_path / name, index=False)
        found.append(replace(read_manifest(tmp_path), place=""))
        (tmp_path / name).unlink()
    stated["logs"][0]["map"] = {"tau_pan": "tau_pan*1.0"}
    (tmp_path / "manifest.yaml").write_text(json.dumps({**stated, "cutoff": 5}))
    found.append(replace(read_manifest(tmp_path), place=""))
    assert found[0] == found[1] == found[2] and found[0].is_dated and found[0].cutoff == 5.0
    assert found[0].logs[0].unit == "000" and found[0].logs[0].mapping == {"tau_pan": "tau_pan*1.0"}


def test_logs_behind_a_url_are_read_where_they_are_needed(folder: Path, fleet: Fleet) -> None:
    files = fsspec.filesystem("memory")
    for name in ("A0.csv", "A1.csv", "A2.csv"):
        files.pipe_file(f"/logs/{name}", (folder / name).read_bytes())
    files.pipe_file("/logs/manifest.yaml", b"rig: turret\nlogs: [{log: A0.csv}, {log: A1.csv}, {log: A2.csv}]")
    found = compare_fleet("memory://logs", quick=True, workers=1)
    assert [one.verdict for one in found.units] == [Verdict.PASS] * 3
    columns = [name for name in found.table if name.startswith("value.")]
    pd.testing.assert_frame_equal(found.table[columns], fleet.table[columns][:3])
    files.pipe_file("/logs/manifest.yaml", b"rig: turret\nlogs: [{log: ../secret.csv}]")
    with pytest.raises(UsageError, match="outside of"):
        read_manifest("memory://logs")


A, B = {"log": "a.csv"}, {"log": "b.csv"}


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"logs": [A, {"log": "c.csv"}]}, ("manifest.yaml: logs[1]: is ", "c.csv, which does not exist")),
        ({"logs": [A, {"log": 9999 * "x"}]}, ("logs[1]: is ", "which does not exist")),
        ({"logs": [A, B, {"log": "./a.csv"}]}, ("logs[2]: is ./a.csv, which is logs[0], too", "list it once")),
        ({"logs": [A, {**B, "serial": "7"}]}, ("logs[1]: has an unknown key 'serial'", "log, unit, time, map")),
        ({"logs": [A, {**B, "unit": 7}]}, ("logs[1].unit: is 7; write a text",)),
        ({"logs": [A, B], "rigs": "turret"}, ("manifest.yaml: has an unknown key 'rigs'",)),
        (
            {"logs": [A, B], "rig": "nowhere.urdf"},
            ("rig: is ", "nowhere.urdf, which does not exist", "turret"),
        ),
        ({"logs": [A, B]}, ("says of no rig", "give --rig")),
        ({"logs": [{**A, "time": "May"}, B]}, ("logs[0].time: is 'May'; write a date such as 2026-11-24",)),
        (
            {"logs": [{**A, "time": 1}, {**B, "time": "2026-01-01"}]},
            ("logs[1]: has a date where logs[0] has a number",),
        ),
        ({"logs": [{**A, "time": 1}, B]}, ("logs[1]: has no time where logs[0] has a number",)),
        ({"logs": [{**A, "map": {"q_pan": "1"}}, B]}, ("names no column",)),
        ({"logs": [{**A, "map": ["q_pan=x"]}, B]}, ("logs[0].map: is ['q_pan=x']; write a table",)),
        ({"logs": []}, ("names no logs",)),
        ({"logs": "all"}, ("logs: is 'all'; write a list",)),
        ({}, ("has no logs; give it",)),
        ({"logs": [A, B], "cutoff": -1}, ("cutoff: is -1; give 0.1 to 1000",)),
    ],
)
def test_a_bad_manifest_is_one_line(run: Run, tmp_path: Path, stated: dict[str, Any], words: tuple[str, ...]) -> None:
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).touch()
    (tmp_path / "manifest.yaml").write_text(json.dumps(stated))
    refused(run("fleet", tmp_path, "-o", tmp_path / "out"), 2, *words)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_none_and_logs_that_cannot_be_used(run: Run, tmp_path: Path) -> None:
    out = ["-o", tmp_path / "out", "--workers", 1]
    refused(run("fleet", tmp_path / "none", *out), 2, "none: is no folder")
    refused(run("fleet", tmp_path, *out), 2, "names no logs")
    (tmp_path / "manifest.csv").write_text("log,rig\na.csv,turret\nb.csv,thesis\n")
    refused(run("fleet", tmp_path, *out), 2, "logs[1]: states the rig thesis, and another log states turret")
    (tmp_path / "manifest.parquet").write_text("no Parquet")
    refused(run("fleet", tmp_path, *out), 2, "holds manifest.parquet and manifest.csv; leave one")
    (tmp_path / "manifest.csv").unlink()
    refused(run("fleet", tmp_path, *out), 2, "manifest.parquet: is not Parquet")
    (tmp_path / "manifest.parquet").unlink()
    for name in "ab":
        (tmp_path / f"{name}.csv").write_text("t,q_pan\n0,1\n")
    code, said, told = run("fleet", tmp_path, *out, "--rig", "turret")
    progress, error = told.split("\n", 1)
    assert progress == "units: 2 computed, 2 of 2 failed"
    refused((code, said, error), 3, "has no log that can be used: ")
    assert len(pd.read_parquet(tmp_path / "out" / "results.parquet")) == 2
