"""A fault planted in a unit is reported of it, in which parameter and since when, and of no other.

One table, whatever the manifest's format; what is computed is not computed again; what cannot be
used is a line.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from gimbal_pin import Log, Rig, compare_fleet, nominal, write_log
from gimbal_pin.dynamics import plant_with
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
from tests.rigs import chain

MONTHS = ("2026-03-01", "2026-04-01", "2026-05-01", "2026-06-01")
TOLERANCES = Vary(
    inertials=("normal", 0.0, 0.02), friction=("normal", 0.0, 0.1), payload={"mass": 0.0}
)
"""Differences between units of one build."""


NO_ERRORS = dict[str, float]()


@cache
def variation(rig: Path) -> Variation:
    return make_variation(nominal(Rig.load(rig)), TOLERANCES)


def record(
    file: Path, rig: Path, unit: int, errors: Mapping[str, float] = NO_ERRORS, seed: int = 0
) -> None:
    """Write the log of a unit with its own tolerances, errors of its own and noise."""
    varied = variation(rig)
    drawn = draw_rigs(varied.inputs, 30)[unit]
    plant = varied.make_body({**varied.choose_values(drawn.probabilities), **errors})
    motion = fourier(plant.rig, 1, 6.5, dt=2.5e-3)
    tau = plant.inverse_dynamics(motion.q, motion.v, motion.a)
    tau += 3e-3 * np.random.default_rng([unit, seed]).standard_normal(tau.shape)
    write_log(Log(file.stem, plant.rig.joints, motion.t, motion.q, motion.v, tau), file)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight like units, one with thick grease, one with a heavy camera, a broken log, one that wears out.

    A motor of the rig states its rotor's inertia.
    """
    out = tmp_path_factory.mktemp("fleet")
    rig = out / "turret.yaml"
    rig.write_text("urdf: turret\npayload: infrared\nmotors:\n  pan: {rotor_inertia: 0.01}\n")
    entries = [{"log": f"A{k}.csv", "unit": f"00{k}", "time": MONTHS[0]} for k in range(8)]
    for k in range(8):
        record(out / f"A{k}.csv", rig, k)
    record(out / "thick.csv", rig, 8, {"friction.tilt": 2.0})
    record(out / "heavy.csv", rig, 9, {"payload.mass": 0.6})
    (out / "broken.csv").write_text((out / "A0.csv").read_text()[:3000])
    entries += [{"log": f"{name}.csv", "time": MONTHS[0]} for name in ("thick", "heavy", "broken")]
    for k, month in enumerate(MONTHS):
        record(out / f"worn{k}.csv", rig, 10, {"friction.pan": 0.5 * k}, seed=k)
        entries.append({"log": f"worn{k}.csv", "unit": "worn", "time": month})
    (out / "manifest.yaml").write_text(json.dumps({"rig": str(rig), "logs": entries}))
    return out


def compare(logs: Path, **options: Any) -> Fleet:
    """Compare in this process."""
    with ThreadPoolExecutor(1) as pool:
        return compare_fleet(logs, executor=pool, **options)


@pytest.fixture(scope="module")
def fleet(folder: Path) -> Fleet:
    """The units compared, in folder `out`."""
    return compare(folder, folder=folder / "out", quick=True)


def test_odd_units_are_named_with_parameter_and_time(fleet: Fleet, folder: Path) -> None:
    """The rotor's stated inertia is a known part of every unit, and no parameter."""
    reasons: dict[str, tuple[Reason, ...]] = {f"00{k}": () for k in range(8)}
    reasons |= dict.fromkeys(["thick", "heavy", "worn"], (Reason.ODD_PARAMETER,))
    reasons["broken"] = (Reason.DATA,)
    assert {one.unit: one.reasons for one in fleet.units} == reasons
    assert fleet.counts == {Verdict.PASS: 8, Verdict.FAIL: 3, Verdict.RETEST: 1}
    found = {one.unit: {own.parameter: own for own in one.deviations} for one in fleet.units}
    assert found["thick"].keys() == {"tilt.Fs", "tilt.Fv"}
    assert found["thick"]["tilt.Fv"].shift == pytest.approx(2 * 0.008, abs=0.006)
    assert {"head_mount.mx", "head_mount.mz"} <= found["heavy"].keys()
    assert found["worn"].keys() <= {"pan.Fs", "pan.Fv"}
    for worn in found["worn"].values():
        assert worn.shift > 0.006
        assert worn.kind is not DeviationKind.OFFSET
        assert worn.since in (None, *MONTHS[1:])
    rig = Rig.load(folder / "turret.yaml")
    expected = {"tilt.Fs": 0.04, "yoke.Izz + head_mount.Izz": rig.phi[[9, 19]].sum()}
    means = fleet.population.loc[[*expected]]
    errors = means["mean"] - [*expected.values()]
    assert (errors.abs() < 4 * means["mean_std"]).all()


def test_the_same_call_computes_nothing_again(
    run: Run, fleet: Fleet, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gimbal_pin.fleet.fleet.identify", None)
    found = result(run, "fleet", folder, "--quick", "--workers", 1, "-o", folder / "out")
    assert found == json.loads(json.dumps(fleet.to_dict()))
    refused(run("fleet", folder, "-o", folder / "out"), 2, "another run's results: other quick")


def test_one_log_is_compared_with_an_earlier_fleet(
    run: Run, fleet: Fleet, folder: Path, tmp_path: Path
) -> None:
    rig = folder / "turret.yaml"
    record(tmp_path / "good.csv", rig, 20)
    record(tmp_path / "001.csv", rig, 21, {"friction.pan": 2.0})
    call = ["fleet", tmp_path, "--rig", rig, "--quick", "--workers", 1]
    found = result(run, *call, "--reference", folder / "out", "-o", tmp_path / "out")
    verdicts = {one["unit"]: one["verdict"] for one in found["units"]}
    assert verdicts == {"good": "pass", "001": "fail"}
    for own in found["units"][0]["deviations"]:
        assert own["parameter"] in ("pan.Fs", "pan.Fv")
        assert own["kind"] == "offset"
    (tmp_path / "001.csv").unlink()
    call += ["-o", tmp_path / "new"]
    refused(run(*call), 2, "has the logs of one unit", "--reference")
    refused(run(*call, "--reference", tmp_path), 2, "is no result of a fleet")
    other = (*call, "--payload", "zoom-lens", "--reference", folder / "out")
    refused(run(*other), 2, "has the payload infrared", "zoom-lens")


def test_a_cause_of_one_unit_alone_fails_it_since_its_first_log_with_it(tmp_path: Path) -> None:
    rig = chain(1)
    cogging = parse_effect("cogging:joint0:amplitude=0.03,harmonic=14", rig)
    plants = [nominal(rig)] * 3 + [plant_with(nominal(rig), [cogging]).plant]
    for k, plant in enumerate(plants):
        log = prescribed(plant, seconds=8.0, torque_noise=0.01 + 1e-4 * k, dt=5e-3)
        write_log(log, tmp_path / f"{k}.csv")
    rows = [f"{k}.csv,{unit},{k}\n" for k, unit in enumerate("ABCC")]
    (tmp_path / "manifest.csv").write_text("log,unit,time\n" + "".join(rows))
    found = compare(tmp_path, rig=rig)
    failed, *others = found.units
    assert (failed.unit, Reason.OWN_CAUSE in failed.reasons) == ("C", True)
    assert [one.verdict for one in others] == [Verdict.PASS] * 2
    (own,) = failed.causes
    assert (own.cause, own.joint, own.status) == ("cogging", "joint0", "named")
    assert float(str(own.since)) == 3
    assert [(one.cause, one.units, one.of) for one in found.causes] == [("cogging", 1, 3)]


# --- Manifests ----------------------------------------------------------------------------------


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """A folder with two empty logs."""
    (tmp_path / "a.csv").touch()
    (tmp_path / "b.csv").touch()
    return tmp_path


def test_manifests_in_yaml_parquet_and_csv_are_one(logs: Path) -> None:
    """Blanks at the ends of a unit's name make no other unit."""
    units = ("001", " 001 ")
    times = MONTHS[:2]
    rows = pd.DataFrame({"log": ["a.csv", "b.csv"], "unit": units, "time": times})
    stated = {"rig": "turret", "cutoff": 5, "logs": rows.to_dict("records")}
    (logs / "manifest.yaml").write_text(json.dumps(stated))
    found = [read_manifest(logs)]
    (logs / "manifest.yaml").unlink()
    rows = rows.assign(rig="turret", cutoff=5.0)
    rows.to_csv(logs / "manifest.csv", index=False)
    found.append(read_manifest(logs))
    (logs / "manifest.csv").unlink()
    rows.to_parquet(logs / "manifest.parquet")
    found.append(read_manifest(logs))
    for one in found:
        assert replace(one, place="") == replace(found[0], place="")
        assert (one.is_dated, one.cutoff) == (True, 5.0)
        assert [log.unit for log in one.logs] == ["001"] * 2


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("logs: [{log: a.csv}, {log: c.csv}]", "logs[1]: is "),
        ("logs: [{log: a.csv}, {log: b.csv}, {log: ./a.csv}]", "logs[2]: is ./a.csv"),
        ("logs: [{log: a.csv}, {log: b.csv, serial: '7'}]", "logs[1]: has an unknown key 'serial'"),
        ("logs: [{log: a.csv, time: May}, {log: b.csv}]", "logs[0].time: is 'May'"),
        ("logs: [{log: a.csv, time: 1}, {log: b.csv, time: '2026-01-01'}]", "logs[1]: has a date"),
        ("logs: [{log: a.csv, unit: É}, {log: b.csv, unit: 'é '}]", "logs[1]"),
        ("logs: [{log: a.csv}, {log: b.csv}]", "names no rig"),
        ("logs: []", "names no logs"),
    ],
)
def test_a_bad_manifest_is_one_line(run: Run, logs: Path, stated: str, said: str) -> None:
    (logs / "manifest.yaml").write_text(stated)
    refused(run("fleet", logs, "-o", logs / "out"), 2, said)
    assert not (logs / "out").exists()


def test_folders_and_logs_that_cannot_be_used_are_one_line(run: Run, logs: Path) -> None:
    call = ["fleet", logs, "-o", logs / "out", "--workers", 1]
    refused(run("fleet", logs / "none", *call[2:]), 2, "none: is no folder")
    (logs / "manifest.csv").write_text("log,rig\na.csv,turret\nb.csv,thesis\n")
    refused(run(*call), 2, "states the rig turret and thesis")
    (logs / "manifest.csv").unlink()
    refused(run(*call, "--rig", "turret"), 3, "has no log that can be used: ")
    assert len(pd.read_parquet(logs / "out" / "results.parquet")) == 2
