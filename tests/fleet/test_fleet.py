"""Laws of fleets: a fault planted in a unit is reported of it, in which parameter and since when, and of no other."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import partial
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
from tests.bench_logs import fourier
from tests.command_line import Run, refused, result
from tests.rigs import chain

MONTHS = ("2026-03-01", "2026-04-01", "2026-05-01", "2026-06-01")
TOLERANCES = Vary(
    inertials=("normal", 0.0, 0.02), friction=("normal", 0.0, 0.1), payload={"mass": 0.0}
)
"""Differences between units of one build."""


@pytest.fixture(scope="module")
def record() -> Callable[..., None]:
    """Write the log of a unit of the turret, with its own tolerances and noise, all in one motion."""
    rig = Rig.load("turret")
    variation = make_variation(nominal(rig), TOLERANCES)
    rigs = draw_rigs(variation.inputs, 30)
    motion = fourier(rig, 1, 6.5, dt=2.5e-3)

    def write(
        file: Path,
        unit: int,
        seed: int = 0,
        mass: float = 0.0,
        joint: str = "",
        viscous: float = 1.0,
    ) -> None:
        values = variation.choose_values(rigs[unit].probabilities)
        plant = stiffen(variation.make_body({**values, "payload.mass": mass}), joint, viscous)
        tau = plant.inverse(motion.q, motion.v, motion.a)
        noise = (
            0.01
            * np.sqrt(np.mean(tau**2, axis=0))
            * np.random.default_rng([unit, seed]).standard_normal(tau.shape)
        )
        write_log(Log(file.stem, rig.joints, motion.t, motion.q, motion.v, tau + noise), file)

    return write


def stiffen(model: Model, joint: str, factor: float) -> Model:
    """The model with so many times the viscous friction at a joint."""
    terms = [
        replace(term, values=tuple(factor * x for x in term.values))
        if (term.effect.name, term.effect.joint) == ("viscous", joint)
        else term
        for term in model.terms
    ]
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
    assert set(found["thick"]) == {"tilt.Fv"} and set(found["worn"]) == {"pan.Fv"}
    thick = found["thick"]["tilt.Fv"]
    worn = found["worn"]["pan.Fv"]
    assert abs(thick.shift - 2 * 0.008) < 0.006 and (thick.kind, thick.since) == (
        DeviationKind.OFFSET,
        None,
    )
    assert {"head_mount.mx", "head_mount.mz"} <= set(found["heavy"])
    assert (
        worn.kind is not DeviationKind.OFFSET
        and worn.shift > 0.006
        and worn.since in (None, *MONTHS[1:])
    )
    assert fleet.units[-1].verdict is Verdict.PASS and fleet.failed == 1
    assert (
        next(one for one in fleet.units if one.unit == "broken").errors[0].startswith("broken.csv:")
    )
    population = fleet.population
    assert abs(population["mean"]["tilt.Fs"] - 0.04) < 4 * population["mean_std"]["tilt.Fs"]
    assert repr(fleet).startswith("Fleet(rig='turret'") and len(fleet.table) == 15


def test_the_same_call_computes_nothing_again(
    run: Run, fleet: Fleet, folder: Path, results: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gimbal_pin.fleet.fleet.identify", None)
    found = result(run, "fleet", folder, "--quick", "--workers", 1, "-o", results)
    assert found == json.loads(json.dumps(fleet.to_dict()))
    assert "thick" in (Path(results) / "report.html").read_text()
    refused(run("fleet", folder, "-o", results), 2, "another run's results: other quick")


def test_one_log_is_compared_with_an_earlier_fleet(
    run: Run, fleet: Fleet, results: str, record: Callable[..., None], tmp_path: Path
) -> None:
    record(tmp_path / "good.csv", 20)
    record(tmp_path / "001.csv", 21, joint="pan", viscous=3.0)
    call = ["fleet", tmp_path, "--rig", "turret", "--quick", "--workers", 1]
    found = result(run, *call, "--reference", results, "-o", tmp_path / "out")
    assert {one["unit"]: one["verdict"] for one in found["units"]} == {
        "good": "pass",
        "001": "fail",
    }
    assert [own["parameter"] for own in found["units"][0]["deviations"]] == ["pan.Fv"]
    (tmp_path / "001.csv").unlink()
    call += ["-o", tmp_path / "new"]
    refused(run(*call), 2, "has the logs of one unit", "--reference")
    refused(run(*call, "--reference", tmp_path), 2, "--reference", "is no result of a fleet")
    refused(
        run(*call, "--payload", "zoom-lens", "--reference", results),
        2,
        "has the payload infrared",
        "zoom-lens",
    )


def write_cogging(file: Path, rig: Rig, seed: int, amplitude: float = 0.0) -> None:
    """Write the log of a unit of one joint, with or without cogging."""
    motion = fourier(rig, 3, 8.0, dt=5e-3)
    cogging = parse_effect(f"cogging:joint0:amplitude={amplitude},harmonic=14", rig)
    plant = plant_with(nominal(rig), [cogging] * (amplitude > 0)).plant
    tau = plant.inverse(motion.q, motion.v, motion.a)
    tau += 0.01 * np.std(tau) * np.random.default_rng(seed).standard_normal(tau.shape)
    write_log(Log("cogs", rig.joints, motion.t, motion.q, motion.v, tau), file)


def test_a_cause_of_one_unit_alone_fails_it_since_its_first_log_with_it(tmp_path: Path) -> None:
    rig = chain(1)
    logs = [("A", 0, 0.0), ("B", 0, 0.0), ("C", 0, 0.0), ("C", 1, 0.03)]
    for k, (_, _, amplitude) in enumerate(logs):
        write_cogging(tmp_path / f"{k}.csv", rig, k, amplitude)
    entries = [
        {"log": f"{k}.csv", "unit": unit, "time": MONTHS[month]}
        for k, (unit, month, _) in enumerate(logs)
    ]
    (tmp_path / "manifest.yaml").write_text(json.dumps({"logs": entries}))
    found = compare(tmp_path, rig=rig)
    assert Reason.OWN_CAUSE in list_verdicts(found)["C"][1]
    assert [asdict(own) for own in found.units[0].causes] == [
        {"cause": "cogging", "joint": "joint0", "status": "named", "since": MONTHS[1]}
    ]
    assert [list_verdicts(found)[unit][0] for unit in "AB"] == [Verdict.PASS] * 2
    assert [(one.cause, one.units, one.of) for one in found.causes] == [("cogging", 1, 3)]


def test_a_failure_of_the_program_is_a_retest(
    record: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from gimbal_pin.identification import identify

    def fail(rig: Rig, logs: list[Log], **options: Any) -> Any:
        if Path(logs[0].name).stem == "2":
            raise TypeError("no float")
        return identify(rig, logs, **options)

    monkeypatch.setattr("gimbal_pin.fleet.fleet.identify", fail)
    for k in range(3):
        record(tmp_path / f"{k}.csv", k)
    found = compare(tmp_path, rig="turret", quick=True)
    assert list_verdicts(found)["2"] == (Verdict.RETEST, (Reason.ERROR,))
    assert found.units[0].errors == ("TypeError: no float",)


@pytest.mark.parametrize("inertia", [1e-3, 0.01])
def test_a_stated_rotor_inertia_is_a_known_part_of_every_unit(
    tmp_path: Path, inertia: float
) -> None:
    """The inertia of the joint without the rotor is estimated, as `identify` does."""
    (tmp_path / "rotor.yaml").write_text(
        f"urdf: turret\nmotors:\n  pan: {{rotor_inertia: {inertia}}}\n"
    )
    rig = Rig.load(tmp_path / "rotor.yaml")
    variation = make_variation(nominal(rig), TOLERANCES)
    motion = fourier(rig, 1, 6.5, dt=5e-3)
    for k, draw in enumerate(draw_rigs(variation.inputs, 3)):
        plant = variation.make_body(variation.choose_values(draw.probabilities))
        tau = plant.inverse(motion.q, motion.v, motion.a)
        tau += 0.002 * np.random.default_rng(k).standard_normal(tau.shape)
        write_log(Log(f"{k}", rig.joints, motion.t, motion.q, motion.v, tau), tmp_path / f"{k}.csv")
    entries = [{"log": f"{k}.csv"} for k in range(3)]
    (tmp_path / "manifest.yaml").write_text(json.dumps({"rig": "rotor.yaml", "logs": entries}))
    found = compare(tmp_path, quick=True)
    assert found.failed == 0 and {one.verdict for one in found.units} == {Verdict.PASS}
    name = "yoke.Izz + head_mount.Izz"
    expected = rig.phi[[9, 19]].sum()
    assert found.population["mean"][name] == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("names", "units"), [(("U0", "U0 ", " U0"), 1), (("U0", "U1", "U 0"), 3), (("ß", "ß", "U"), 2)]
)
def test_blanks_at_the_ends_of_a_units_name_make_no_other_unit(
    tmp_path: Path, names: tuple[str, ...], units: int
) -> None:
    for k in range(3):
        (tmp_path / f"{k}.csv").touch()
    stated = {
        "rig": "turret",
        "logs": [{"log": f"{k}.csv", "unit": name} for k, name in enumerate(names)],
    }
    (tmp_path / "manifest.yaml").write_text(json.dumps(stated))
    assert len({log.unit for log in read_manifest(tmp_path).logs}) == units


@pytest.mark.parametrize("names", [("U0", "u0"), ("unit a", "Unit A "), ("É", "é")])
def test_units_that_differ_by_letter_case_alone_are_refused(
    run: Run, tmp_path: Path, names: tuple[str, str]
) -> None:
    """Whether a manifest or files name them."""
    for name in names:
        (tmp_path / f"{name}.csv").touch()
    refused(
        run("fleet", tmp_path, "--rig", "turret", "-o", tmp_path / "out"),
        2,
        *(name.strip() for name in names),
    )
    stated = {"rig": "turret", "logs": [{"log": f"{name}.csv", "unit": name} for name in names]}
    (tmp_path / "manifest.yaml").write_text(json.dumps(stated))
    refused(
        run("fleet", tmp_path, "-o", tmp_path / "out"),
        2,
        "logs[1]",
        *(name.strip() for name in names),
    )


def test_manifests_in_yaml_parquet_and_csv_are_one(folder: Path, tmp_path: Path) -> None:
    stated = json.loads((folder / "manifest.yaml").read_text())
    rows = pd.DataFrame([{**entry, "rig": "turret", "cutoff": 5.0} for entry in stated["logs"]])
    (tmp_path / "map.yaml").write_text("tau_pan: tau_pan*1.0")
    rows["map"] = None
    rows.loc[0, "map"] = "map.yaml"
    for name in rows["log"]:
        (tmp_path / name).touch()
    found = []
    for write, name in ((partial(rows.to_csv, index=False), "csv"), (rows.to_parquet, "parquet")):
        write(tmp_path / f"manifest.{name}")
        found.append(replace(read_manifest(tmp_path), place=""))
        (tmp_path / f"manifest.{name}").unlink()
    stated["logs"][0]["map"] = {"tau_pan": "tau_pan*1.0"}
    (tmp_path / "manifest.yaml").write_text(json.dumps({**stated, "cutoff": 5}))
    found.append(replace(read_manifest(tmp_path), place=""))
    assert found[0] == found[1] == found[2] and found[0].is_dated and found[0].cutoff == 5.0
    assert found[0].logs[0].unit == "000" and found[0].logs[0].mapping == {"tau_pan": "tau_pan*1.0"}


A = {"log": "a.csv"}
B = {"log": "b.csv"}


@pytest.mark.parametrize(
    ("stated", "place"),
    [
        ({"logs": [A, {"log": "c.csv"}]}, "logs[1]: is "),
        ({"logs": [A, B, {"log": "./a.csv"}]}, "logs[2]: is ./a.csv"),
        ({"logs": [A, {**B, "serial": "7"}]}, "logs[1]: has an unknown key 'serial'"),
        ({"logs": [A, {**B, "unit": 7}]}, "logs[1].unit: is 7"),
        ({"logs": [A, B], "rig": "nowhere.urdf"}, "rig: is "),
        ({"logs": [A, B]}, "names no rig"),
        ({"logs": [{**A, "time": "May"}, B]}, "logs[0].time: is 'May'"),
        ({"logs": [{**A, "time": 1}, {**B, "time": "2026-01-01"}]}, "logs[1]: has a date"),
        ({"logs": [{**A, "map": ["q_pan=x"]}, B]}, "logs[0].map: is ['q_pan=x']"),
        ({"logs": []}, "names no logs"),
        ({"logs": [A, B], "cutoff": -1}, "cutoff: is -1"),
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
    (tmp_path / "manifest.parquet").write_text("no Parquet")
    refused(run(*call), 2, "holds manifest.parquet and manifest.csv")
    (tmp_path / "manifest.csv").unlink()
    refused(run(*call), 2, "manifest.parquet: cannot be read")
    (tmp_path / "manifest.parquet").unlink()
    for name in "ab":
        (tmp_path / f"{name}.csv").write_text("t,q_pan\n0,1\n")
    refused(run(*call, "--rig", "turret"), 3, "has no log that can be used: ")
    assert len(pd.read_parquet(tmp_path / "out" / "results.parquet")) == 2
