"""Logs of many rigs compared: units that deviate from the others, in which parameter, and since when."""

from __future__ import annotations

import json
import os
from collections import Counter, defaultdict
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.errors import DataError, GimbalPinError, UsageError
from gimbal_pin.fleet.executor import TABLE, Value, map_units, read_settings
from gimbal_pin.fleet.manifest import FleetLog, Manifest, read_manifest
from gimbal_pin.fleet.population import Comparison, Deviation, compare_units
from gimbal_pin.fleet.study import describe_rig
from gimbal_pin.identification import identify
from gimbal_pin.log.io import read_log
from gimbal_pin.log.io.readers import files_of
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from pandas import DataFrame

LARGEST_ERROR_RATIO = 3.0
"""Standard deviation of a unit's parameter, in that of the median unit, beyond which the unit is tested again. Logs of
one motion of 8 s with other noise differ by a factor of up to 2.4 (turret, 16 logs). Double: a log that shows a
parameter six times worse than the others passes."""
MAJORITY = 0.5
"""Share of the other units from which a cause or a fault is usual in the fleet and not a unit's own."""
EARLIER = "earlier fleet: "
"""Prefix of the units of a reference, of which one may have the same name as a unit of these logs."""


class Verdict(str, Enum):
    """Result for a unit."""

    __str__ = str.__str__

    PASS = "pass"
    FAIL = "fail"
    RETEST = "retest"


class Reason(str, Enum):
    """Reason why a unit does not pass."""

    __str__ = str.__str__

    ODD_PARAMETER = "odd-parameter"
    """A parameter deviates from the other units': fails."""
    OWN_CAUSE = "own-cause"
    """A cause is named that less than half of the other units have: fails."""
    DATA = "data"
    """A log cannot be used, or has a fault that less than half of the other units have: test again."""
    ERROR = "error"
    """The program failed on a log: test again, and report it."""
    UNCERTAIN = "uncertain"
    """A parameter's error exceeds the fleet's spread and `LARGEST_ERROR_RATIO` times the median: test again."""


COLUMNS = ("serial", "error", "units", "verdict", "findings")
"""Columns of the table of logs, which lack where no log has a value."""
FAILING = (Reason.ODD_PARAMETER, Reason.OWN_CAUSE)
Finding = tuple[str, str | None, str]
"""Cause, joint or None for the rig, and status: "named", or "data" of a fault of the log."""


@dataclass(frozen=True)
class FleetCause:
    """Cause at a joint, None for the whole rig, with the number of units that have it, `of` those diagnosed."""

    cause: str
    joint: str | None
    units: int
    of: int


@dataclass(frozen=True)
class UnitCause:
    """Cause or fault that a unit has and most others do not.

    Attributes:
        cause: Its name.
        joint: Its joint; None for the whole rig.
        status: "named", or "data" of a fault.
        since: Time of the first log with it, as the manifest states it; None: no earlier log was diagnosed.
    """

    cause: str
    joint: str | None
    status: str
    since: str | None

    def __str__(self) -> str:
        """Return cause and joint as a phrase."""
        return f"{self.cause} at {self.joint or 'the rig'}"


@dataclass(frozen=True, eq=False)
class JudgedUnit:
    """Unit of a fleet with its verdict.

    Attributes:
        unit: Serial number.
        verdict: Pass, fail or retest.
        reasons: Reasons why it does not pass.
        logs: Number of its logs.
        deviations: Parameters that deviate, the least probable first; `since` as the manifest states it.
        causes: Causes and faults that most other units do not have.
        uncertain: Parameters that its logs show too badly.
        errors: Reasons why logs could not be used.
    """

    unit: str
    verdict: Verdict
    reasons: tuple[Reason, ...]
    logs: int
    deviations: tuple[Deviation, ...] = ()
    causes: tuple[UnitCause, ...] = ()
    uncertain: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Fleet(Record):
    """Result of `compare_fleet`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        reference: Folder of the fleet that units are compared with; None: these units.
        logs: Number of logs.
        failed: Number of logs without a result.
        units: Those that fail first, then those to test again, then those that pass.
        population: Parameters of the fleet that units are compared with, see `Comparison`, each with its SI `unit` and
            the offset `detectable` that the median unit shows in one of two cases.
        causes: Named causes of these units, the most common first.
        is_dated: Whether times are dates, s since 1970; else they are in the manifest's own unit.
        table: A row per log: serial, time, error, parameters with deviations, accuracy, verdict, findings.
    """

    rig: str
    payload: str | None
    reference: str | None
    logs: int
    failed: int
    units: tuple[JudgedUnit, ...]
    population: DataFrame = field(repr=False)
    causes: tuple[FleetCause, ...]
    is_dated: bool = field(repr=False)
    table: DataFrame = field(repr=False)

    ROWS: ClassVar[str] = "units"
    __repr__ = brief

    @property
    def counts(self) -> dict[Verdict, int]:
        """Verdict → number of units."""
        counts = Counter(unit.verdict for unit in self.units)
        return {verdict: counts[verdict] for verdict in Verdict}

    def to_dict(self) -> dict[str, Any]:
        """Return the values of the JSON output."""
        return {
            "schema": 1,
            **{
                name: getattr(self, name)
                for name in ("rig", "payload", "reference", "logs", "failed", "counts")
            },
            "units": [asdict(unit) for unit in self.units],
            "population": self.population.rename_axis("name").reset_index().to_dict("records"),
            "causes": [asdict(cause) for cause in self.causes],
        }


@check_arguments
def compare_fleet(
    logs: str | Path | Manifest,
    *,
    rig: str | Path | Rig | None = None,
    payload: str | None = None,
    folder: str | Path | None = None,
    reference: str | None = None,
    quick: bool = False,
    executor: Executor | None = None,
    quiet: bool = True,
) -> Fleet:
    """Identify and diagnose many rigs' logs, and name the units that deviate from the others.

        fleet = compare_fleet("logs", folder="out")

    Args:
        logs: Folder with logs and their manifest, see `manifest.read_manifest`, or what that returned.
        rig: The rig that all units are built as; None: the manifest's.
        payload: The payload that all units carry; None: the manifest's, or the rig's own.
        folder: Folder of the results; logs in it are not computed again. None: no folder.
        reference: Folder of an earlier fleet's results to compare with: one unit and a short log of it suffice then.
        quick: True identifies only, and looks for no causes.
        executor: Runs the logs; None: a process per processor of this machine.
        quiet: True shows no progress bar.

    Raises:
        UsageError: An argument or a file is wrong; it names which.
        DataError: Fewer than two units, of a reference and these logs, could be identified.
    """
    manifest = logs if isinstance(logs, Manifest) else read_manifest(logs)
    wanted = manifest.rig if rig is None else rig
    if wanted is None:
        raise UsageError(
            manifest.place, "names no rig", "add 'rig: NAME' to manifest.yaml, or give --rig"
        )
    loaded = wanted if isinstance(wanted, Rig) else Rig.load(wanted, payload or manifest.payload)
    settings = list_settings(loaded, manifest, quick)
    earlier = None if reference is None else read_reference(reference, settings)
    if earlier is None and len({log.unit for log in manifest.logs}) < 2:
        raise UsageError(
            manifest.place, "has the logs of one unit", "add other units' logs, or give --reference"
        )
    work = partial(examine_log, rig=loaded, cutoff=manifest.cutoff, quick=quick)
    table = map_units(work, manifest.logs, executor, folder=folder, settings=settings, quiet=quiet)
    table = table.reindex(columns=list(dict.fromkeys([*table, *COLUMNS])))
    # A log on which the program failed has no row but its error.
    table["is_crash"] = table["serial"].isna()
    table["serial"] = [log.unit for log in manifest.logs]
    for name in ("path", "time", "taken"):
        table[name] = [getattr(log, name) for log in manifest.logs]
    return judge_fleet(loaded, manifest, reference, table, earlier)


def examine_log(log: FleetLog, rig: Rig, cutoff: float | None, quick: bool) -> dict[str, Value]:
    """Return a log's row.

    Its columns: `value.NAME`, `std.NAME` per parameter and their `units` as JSON; `torque_rmse.JOINT` of the fit, N m;
    unless `quick` the `verdict`, and `findings` as JSON, which a log too short for a diagnosis lacks. Of a log that
    cannot be used the `error`.
    """
    filtering = None if cutoff is None else Filtering(cutoff=cutoff)
    try:
        read = read_log(log.path, rig, log.mapping)
        fit = identify(rig, [read], holdout="none", filtering=filtering, examined="never")
        row: dict[str, Value] = {
            "serial": log.unit,
            "units": json.dumps(dict(zip(fit.names, fit.units))),
        }
        row |= zip([f"value.{name}" for name in fit.names], fit.estimate.theta.tolist())
        row |= zip([f"std.{name}" for name in fit.names], fit.estimate.std.tolist())
        row |= {f"torque_rmse.{joint}": rmse for joint, rmse in fit.train.torque_rmse.items()}
        with suppress(DataError):
            diagnosis = None if quick else diagnose(rig, [read])
            if diagnosis is not None:
                row |= {
                    "verdict": diagnosis.verdict,
                    "findings": json.dumps(list_findings(diagnosis)),
                }
        return row
    except GimbalPinError as error:
        return {"serial": log.unit, "error": str(error)}


def list_findings(diagnosis: Diagnosis) -> list[Finding]:
    """Return named causes and faults of a log."""
    findings = [(one.cause, one.joint, "data") for one in diagnosis.spoiling]
    findings += [
        (one.cause, one.joint, one.status) for one in diagnosis.findings if one.status == "named"
    ]
    return list(dict.fromkeys(findings))


def list_settings(rig: Rig, manifest: Manifest, quick: bool) -> dict[str, object]:
    """Return all that the rows depend on: the rig and the logs, with the times of their last changes."""
    return {
        "rig": rig.name,
        "payload": rig.payload,
        "cutoff": manifest.cutoff,
        "model": describe_rig(rig),
        "quick": quick,
        "logs": [asdict(log) for log in manifest.logs],
        "changed": [
            os.stat(file).st_mtime_ns for log in manifest.logs for file in files_of(log.path)
        ],
    }


def read_reference(folder: str, settings: Mapping[str, object]) -> DataFrame:
    """Return the identified logs of an earlier fleet; `UsageError` unless it was of the same rig and filter."""
    import pandas as pd

    try:
        earlier = read_settings(folder)
        table = pd.read_parquet(Path(folder) / TABLE).dropna(subset="units")
    except (OSError, ValueError) as error:
        what = f"{folder} is no result of a fleet ({error})"
        raise UsageError(
            "--reference", what, "give a folder that 'gimbal-pin fleet -o' wrote"
        ) from error
    for key in ("rig", "payload", "cutoff"):
        if earlier.get(key) != settings[key]:
            what = f"has the {key} {earlier.get(key)}"
            raise UsageError("--reference", what, f"give one with the {key} {settings[key]}")
    return table.reindex(columns=list(dict.fromkeys([*table, *COLUMNS]))).assign(time=0.0)


class Findings(NamedTuple):
    """Findings of logs: of each log, the units that have each, and the units that were diagnosed."""

    of_logs: list[list[Finding]]
    owners: Mapping[Finding, set[str]]
    diagnosed: set[str]

    def is_own(self, finding: Finding, unit: str) -> bool:
        """Return whether less than `MAJORITY` of the other units have a finding."""
        return len(self.owners.get(finding, set()) - {unit}) < MAJORITY * len(
            self.diagnosed - {unit}
        )


def read_findings(table: DataFrame) -> Findings:
    """Return the findings in a table of logs."""
    texts = table["findings"].astype(object).fillna("[]")
    of_logs = [
        [(cause, joint, status) for cause, joint, status in json.loads(text)] for text in texts
    ]
    owners = defaultdict[Finding, set[str]](set)
    for unit, findings in zip(table["serial"], of_logs):
        for finding in findings:
            owners[finding].add(unit)
    return Findings(of_logs, owners, set(table["serial"][table["verdict"].notna()]))


def list_parameters(table: DataFrame) -> dict[str, str]:
    """Return parameter → unit of measure, of those in at least half of the logs: a base that moves shows more."""
    stated = [json.loads(text) for text in table["units"]]
    count = Counter(name for units in stated for name in units)
    return {
        name: unit
        for units in stated
        for name, unit in units.items()
        if count[name] >= MAJORITY * len(table)
    }


def judge_fleet(
    rig: Rig, manifest: Manifest, reference: str | None, table: DataFrame, earlier: DataFrame | None
) -> Fleet:
    """Return each unit's verdict from the rows of its logs."""
    import pandas as pd

    findings = read_findings(table)
    others = findings if earlier is None else read_findings(earlier)
    named = zip(table["serial"], findings.of_logs)
    table["own"] = [
        [finding for finding in own if others.is_own(finding, unit)] for unit, own in named
    ]
    table["is_spoilt"] = [any(status == "data" for *_, status in own) for own in table["own"]]
    logs = table[table["units"].notna() & ~table["is_spoilt"]]
    fleet = set(logs["serial"])
    if logs.empty:
        why = ": ".join(["", *table["error"].dropna()[:1]])
        raise DataError(
            manifest.place,
            f"has no log that can be used{why}",
            "record them as 'gimbal-pin check' says",
        )
    if earlier is not None:
        earlier = earlier.assign(serial=EARLIER + earlier["serial"])
        fleet = set(earlier["serial"])
        logs = pd.concat([logs, earlier])
    if len(fleet) < 2:
        raise DataError(
            manifest.place, "has fewer than two units whose logs can be used", "record more"
        )
    units = list_parameters(logs)
    values, stds = (
        logs.reindex(columns=[f"{kind}.{name}" for name in units])
        .astype(float)
        .set_axis([*units], axis=1)
        for kind in ("value", "std")
    )
    compared = compare_units(
        values, stds, logs["serial"].tolist(), logs["time"].tolist(), reference=[*fleet]
    )
    largest = LARGEST_ERROR_RATIO * compared.errors.loc[[*fleet]].median()
    is_uncertain = compared.errors > np.hypot(compared.population["spread"], largest)
    judged = [
        judge_unit(str(unit), rows, compared, is_uncertain)
        for unit, rows in table.groupby("serial")
    ]
    order = [Verdict.FAIL, Verdict.RETEST, Verdict.PASS]
    judged.sort(
        key=lambda one: (
            order.index(one.verdict),
            min((own.p_value for own in one.deviations), default=1.0),
        )
    )
    causes = [
        FleetCause(cause, joint, len(having), len(findings.diagnosed))
        for (cause, joint, _), having in findings.owners.items()
    ]
    return Fleet(
        rig=rig.name,
        payload=rig.payload,
        reference=reference,
        logs=len(table),
        failed=int(table["error"].notna().sum()),
        units=tuple(judged),
        population=compared.population.assign(
            unit=units, detectable=compared.detectable.loc[[*fleet]].median()
        ),
        causes=tuple(sorted(causes, key=lambda cause: -cause.units)),
        is_dated=manifest.is_dated,
        table=table.drop(columns=["own", "is_crash", "is_spoilt"]),
    )


def judge_unit(
    unit: str, rows: DataFrame, compared: Comparison, is_uncertain: DataFrame
) -> JudgedUnit:
    """Return a unit's verdict from the rows of its logs."""
    rows = rows.sort_values("time", kind="stable")
    taken = dict(zip(rows["time"], rows["taken"]))
    deviations = [
        replace(own, since=taken.get(own.since)) for own in compared.deviations if own.unit == unit
    ]
    uncertain = [
        name for name in is_uncertain if unit in is_uncertain.index and is_uncertain.at[unit, name]
    ]
    causes = dict[Finding, UnitCause]()
    was_diagnosed = False
    for own, when, verdict in zip(rows["own"], rows["taken"], rows["verdict"]):
        since = str(when) if was_diagnosed else None
        for cause, joint, status in own:
            causes.setdefault((cause, joint, status), UnitCause(cause, joint, status, since))
        was_diagnosed |= isinstance(verdict, str)
    is_error = rows["error"].notna()
    holds = {
        Reason.ODD_PARAMETER: bool(deviations),
        Reason.OWN_CAUSE: any(
            status == "named" for own in rows["own"][~rows["is_spoilt"]] for *_, status in own
        ),
        Reason.DATA: bool((is_error & ~rows["is_crash"] | rows["is_spoilt"]).any()),
        Reason.ERROR: bool(rows["is_crash"].any()),
        Reason.UNCERTAIN: bool(uncertain),
    }
    reasons = tuple(reason for reason in holds if holds[reason])
    verdict = (
        Verdict.FAIL if {*reasons} & {*FAILING} else Verdict.RETEST if reasons else Verdict.PASS
    )
    errors = [
        error.replace(f"{Path(path).parent}/", "")
        for path, error in rows[["path", "error"]][is_error].to_numpy()
    ]
    return JudgedUnit(
        unit,
        verdict,
        reasons,
        len(rows),
        tuple(deviations),
        tuple(causes.values()),
        tuple(uncertain),
        tuple(errors),
    )
