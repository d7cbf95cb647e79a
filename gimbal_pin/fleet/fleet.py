"""Many rigs' logs compared: which unit is not like its siblings, in what, and since when."""

from __future__ import annotations

import json
import os
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from functools import partial
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.errors import DataError, GimbalPinError, UsageError
from gimbal_pin.fleet.engine import RUN, Capacity, ExecutorFactory, Value, compute_table, open_folder, read_table
from gimbal_pin.fleet.manifest import FleetLog, Manifest, local_copy, read_manifest
from gimbal_pin.fleet.population import Comparison, Deviation, DeviationKind, compare_units
from gimbal_pin.fleet.study import describe_rig
from gimbal_pin.identification import identify
from gimbal_pin.log.io import read_log
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from pandas import DataFrame

SCATTER = 3.0
"""How far apart the stated errors of like logs may lie: of one motion of 8 s with other noise they differ by up to a
factor of 2.4 (turret, 16 logs)."""
MAJORITY = 0.5
"""Share of the siblings from which a cause or a fault is the fleet's way rather than a unit's own."""


class Verdict(str, Enum):
    """What becomes of a unit."""

    __str__ = str.__str__

    PASS = "pass"
    FAIL = "fail"
    RETEST = "retest"


class Reason(str, Enum):
    """Why a unit does not pass."""

    __str__ = str.__str__

    ODD_PARAMETER = "odd-parameter"
    """A parameter is not like its siblings': fails."""
    OWN_CAUSE = "own-cause"
    """Less than half of its siblings have a cause that is named for it: fails."""
    DATA = "data"
    """A log cannot be used, or has a fault that less than half of its siblings' have: test again."""
    ERROR = "error"
    """The program ended on a log: test again, and report it."""
    UNCERTAIN = "uncertain"
    """Its error in a parameter exceeds the fleet's spread and `SCATTER` times its siblings' error: test again."""


FindingKey = tuple[str, str | None, str]
"""Cause, joint or None for the rig, and status: "named", or "data" of a fault of the log."""


def examine_log(log: FleetLog, rig: Rig, cutoff: float | None, quick: bool, seed: int) -> dict[str, Value]:
    """Return a log's row; the `error` of one that cannot be used is the row's.

    `value.NAME` and `std.NAME` per parameter, from the whole log, `units` their units; `torque_rmse.JOINT`, N m, and
    `fit_percent.JOINT` on the third that a second fit has not seen; unless `quick`, `findings` as JSON: cause, joint,
    status.
    """
    head: dict[str, Value] = {"log": log.path, "serial": log.unit, "time": log.time}
    copy = Path(log.path)
    try:
        with local_copy(log.path) as copy:
            read = read_log(copy, rig, log.mapping)
        return {**head, **identify_log(read, rig, cutoff), **({} if quick else diagnose_log(read, rig, seed))}
    except GimbalPinError as error:
        return {**head, "error": str(error).replace(str(copy), log.path)}


def identify_log(log: Log, rig: Rig, cutoff: float | None) -> dict[str, Value]:
    """Return a log's parameters and how well they hold, see `examine_log`."""
    filtering = None if cutoff is None else Filtering(cutoff=cutoff)
    whole = identify(rig, [log], holdout="none", filtering=filtering, examined="never")
    units = json.dumps(dict(zip(whole.names, whole.units)))
    row: dict[str, Value] = {"seconds": float(log.t[-1] - log.t[0]), "samples": len(log), "units": units}
    row |= zip((f"value.{name}" for name in whole.names), whole.estimate.theta.tolist())
    row |= zip((f"std.{name}" for name in whole.names), whole.estimate.std.tolist())
    try:
        judged = identify(rig, [log], filtering=filtering, examined="never").held_out
    except DataError:  # its first two thirds do not show every parameter
        judged = None
    figures = ((figure, getattr(judged, figure, {})) for figure in ("torque_rmse", "fit_percent"))
    return row | {f"{figure}.{joint}": known.get(joint) for figure, known in figures for joint in rig.joints}


def diagnose_log(log: Log, rig: Rig, seed: int) -> dict[str, Value]:
    """Return verdict and findings; a log that is too short for them has neither, and `undiagnosed` says why."""
    try:
        found = diagnose(rig, [log], rng=np.random.default_rng(seed))
    except DataError as error:
        return {"verdict": None, "findings": "[]", "undiagnosed": str(error)}
    findings = [{"cause": one.cause, "joint": one.joint, "status": "data"} for one in found.spoiling]
    findings += [{"cause": one.cause, "joint": one.joint, "status": one.status} for one in found.findings]
    return {"verdict": found.verdict, "findings": json.dumps(findings), "undiagnosed": None}


@dataclass(frozen=True)
class FleetCause:
    """A cause at a joint, None for the whole rig, and how many units have it, `of` how many that were diagnosed."""

    cause: str
    joint: str | None
    units: int
    of: int


@dataclass(frozen=True)
class UnitCause:
    """A cause or fault that is a unit's own.

    Attributes:
        cause: Its name.
        joint: Where; None for the whole rig.
        status: "named", or "data" of a fault.
        since: When the first log with it was taken, as the manifest states it; None: the unit was never without it.
    """

    cause: str
    joint: str | None
    status: str
    since: str | None

    def __str__(self) -> str:
        """Return it as people read it."""
        return f"{self.cause} at {self.joint or 'the rig'}"


@dataclass(frozen=True, eq=False)
class JudgedUnit:
    """A unit of a fleet.

    Attributes:
        unit: Serial number.
        verdict: Pass, fail or retest.
        reasons: Why it does not pass.
        logs: Number of its logs.
        deviations: Parameters that are not like its siblings', the least probable first.
        causes: Its own causes and faults.
        uncertain: Parameters that its logs do not tell well enough.
        errors: What kept its logs from being used.
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
    """The result of `compare_fleet`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        reference: Folder of the fleet that units are judged against; None: against each other.
        logs: Number of logs, and `failed` of these without a result.
        failed: See there.
        units: Those that fail first, then those to test again, then those that pass.
        population: The parameters over the fleet that units are judged against, see `Comparison`, each with its SI
            `unit` and the offset `detectable` that the median unit's logs show in one of two cases.
        estimates: The units' parameters, partially pooled with the fleet's.
        causes: Named causes of these units, the most common first.
        is_dated: Whether times are dates, s since 1970; else in the manifest's own unit.
        table: One row per log: serial, time, error, parameters with deviations, accuracy, verdict, findings.
    """

    rig: str
    payload: str | None
    reference: str | None
    logs: int
    failed: int
    units: tuple[JudgedUnit, ...]
    population: DataFrame = field(repr=False)
    estimates: DataFrame = field(repr=False)
    causes: tuple[FleetCause, ...]
    is_dated: bool = field(repr=False)
    table: DataFrame = field(repr=False)

    ROWS: ClassVar[str] = "units"
    __repr__ = brief

    @property
    def counts(self) -> dict[Verdict, int]:
        """Verdict → number of units."""
        found = Counter(one.verdict for one in self.units)
        return {verdict: found[verdict] for verdict in Verdict}

    def since(self, deviation: Deviation) -> str | None:
        """Return when the first log was taken that shows a step, as the manifest states it, or that log's name.

        None: all of the unit's logs have the deviation, or more and more of it.
        """
        if deviation.kind is not DeviationKind.STEP:
            return None
        is_first = (self.table["serial"] == deviation.unit) & (self.table["time"] == deviation.since)
        return str(self.table["taken"][is_first].iloc[0])

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds; null for what is unknown."""
        units = [asdict(one) for one in self.units]
        for told, one in zip(units, self.units):
            for own, deviation in zip(told["deviations"], one.deviations):
                own |= {"score": deviation.score, "since": self.since(deviation)}
        return {
            "schema": 1,
            **{name: getattr(self, name) for name in ("rig", "payload", "reference", "logs", "failed", "counts")},
            "units": units,
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
    seed: int = 0,
    executor: ExecutorFactory | None = None,
    workers: int | Capacity = 0,
    quiet: bool = True,
) -> Fleet:
    """Identify and diagnose many rigs' logs, and find the units that are not like their siblings.

        fleet = compare_fleet("logs", folder="out")

    Args:
        logs: Folder or URL with logs and their manifest, see `manifest.read_manifest`, or what that returned.
        rig: The rig that all units are built as; None: what the manifest says.
        payload: What they all carry; None: what the manifest says, or the rig's own.
        folder: Where results go as Parquet, a path or URL; what is there is not computed again. None: nowhere.
        reference: Folder of an earlier fleet's results, which units are then judged against: even one, and a short log
            of it.
        quick: True identifies only, and looks for no causes.
        seed: Seed of everything random.
        executor: Makes what reads the logs, see `gimbal_pin.fleet`; None: processes of this machine.
        workers: How many logs are read at once; 0: as many as there are processors; 1: in this process.
        quiet: True shows no progress bar.

    Raises:
        UsageError: Something asked for cannot be; it names what.
        DataError: Fewer than two units, of a reference and these logs, could be identified.
    """
    manifest = logs if isinstance(logs, Manifest) else read_manifest(logs)
    wanted = manifest.rig if rig is None else rig
    if wanted is None:
        raise UsageError(manifest.place, "says of no rig", "state it in manifest.yaml as 'rig:', or give --rig")
    loaded = wanted if isinstance(wanted, Rig) else Rig.load(wanted, payload or manifest.payload)
    settings = _list_settings(loaded, manifest, quick, seed)
    earlier = None if reference is None else _read_reference(reference, settings)
    if earlier is None and len({log.unit for log in manifest.logs}) < 2:
        raise UsageError(manifest.place, "has the logs of one unit", "add its siblings', or give --reference")
    work = partial(examine_log, rig=loaded, cutoff=manifest.cutoff, quick=quick, seed=seed)
    table = compute_table(work, manifest.logs, settings, folder, executor, workers, quiet)
    table = table.reindex(columns=list(dict.fromkeys(["unit", "error", "log", *table, "verdict", "findings"])))
    table["reported"] = table["log"].notna()  # what ended the program left nothing but an error
    for column, name in (("log", "path"), ("serial", "unit"), ("time", "time"), ("taken", "taken")):
        table[column] = [getattr(log, name) for log in manifest.logs]
    return _judge_fleet(loaded, manifest, reference, table, earlier)


def _list_settings(rig: Rig, manifest: Manifest, quick: bool, seed: int) -> dict[str, object]:
    """What the rows depend on: the rig and the logs, local ones with their sizes and dates."""
    paths = [log.path for log in manifest.logs]
    states = [os.stat(path) for path in paths if "://" not in path and os.path.exists(path)]
    return {
        "rig": rig.name,
        "payload": rig.payload,
        "model": describe_rig(rig),
        "cutoff": manifest.cutoff,
        "quick": quick,
        "seed": seed,
        "logs": [asdict(log) for log in manifest.logs] + [[one.st_size, one.st_mtime_ns] for one in states],
    }


def _read_reference(folder: str, settings: Mapping[str, object]) -> DataFrame:
    """The identified logs of an earlier fleet; `UsageError` unless it was of the same rig and filter."""
    mend = "give what 'gimbal-pin fleet -o' wrote"
    try:
        earlier = json.loads(open_folder(folder).cat_file(RUN))["settings"]
        table = read_table(folder)
        known = table[table["error"].isna()].dropna(subset=["serial", "time", "units"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError("--reference", f"{folder} is no folder of an earlier fleet ({error!r})", mend) from error
    if known.empty:
        raise UsageError("--reference", f"{folder} has no identified logs", mend)
    for key in ("rig", "payload", "cutoff"):
        if earlier.get(key) != settings[key]:
            what = f"has the {key} {earlier.get(key)}, and these logs {settings[key]}"
            raise UsageError("--reference", f"{folder} {what}", f"compare units of one {key}")
    return known.reindex(columns=list(dict.fromkeys([*known, "verdict", "findings"])))


def _read_findings(table: DataFrame) -> list[list[FindingKey]]:
    """Named causes and faults of each log; none of one that was not diagnosed."""
    texts = table["findings"].astype(object).fillna("[]")
    keys = [dict.fromkeys((one["cause"], one["joint"], one["status"]) for one in json.loads(text)) for text in texts]
    return [[key for key in own if key[2] in ("named", "data")] for own in keys]


def _list_owners(table: DataFrame) -> tuple[dict[FindingKey, set[str]], set[str]]:
    """FindingKey → the units that have it, and the units that were diagnosed."""
    owners = defaultdict[FindingKey, set[str]](set)
    for unit, findings in zip(table["serial"], _read_findings(table)):
        for key in findings:
            owners[key].add(unit)
    return owners, set(table["serial"][table["verdict"].notna()])


def _find_own(table: DataFrame, siblings: DataFrame) -> Iterator[list[FindingKey]]:
    """Yield of each log the findings that less than `MAJORITY` of its unit's siblings have."""
    owners, diagnosed = _list_owners(siblings)
    for unit, keys in zip(table["serial"], _read_findings(table)):
        others = diagnosed - {unit}
        yield [key for key in keys if len(owners[key] & others) < MAJORITY * len(others)]


def _list_parameters(table: DataFrame) -> dict[str, str]:
    """Parameters that at least half of the logs tell, as a base that moves shows more → their units."""
    told = [json.loads(text) for text in table["units"]]
    count = Counter(name for own in told for name in own)
    return {name: unit for own in told for name, unit in own.items() if count[name] >= MAJORITY * len(table)}


def _judge_fleet(
    rig: Rig, manifest: Manifest, reference: str | None, table: DataFrame, earlier: DataFrame | None
) -> Fleet:
    """Return what the rows say of each unit."""
    import pandas as pd

    for rows in (table,) if earlier is None else (table, earlier):
        rows["own"] = list(_find_own(rows, table if earlier is None else earlier))
        rows["spoilt"] = [any(status == "data" for *_, status in own) for own in rows["own"]]
    used = table[table["error"].isna() & ~table["spoilt"]]
    if used.empty:
        why = f": {table['error'].dropna().iloc[0]}" if table["error"].notna().any() else ""
        raise DataError(manifest.place, f"has no log that can be used{why}", "record them as 'gimbal-pin check' says")
    logs, of_fleet = used.assign(label=used["serial"]), None
    if earlier is not None:  # a unit may have been in the earlier fleet under the same serial number
        earlier = earlier[~earlier["spoilt"]].assign(label="earlier/" + earlier["serial"])
        logs, of_fleet = pd.concat([logs, earlier]), sorted(set(earlier["label"]))
    siblings = of_fleet or sorted(set(used["serial"]))
    if len(siblings) < 2:
        raise DataError(manifest.place, "has fewer than two units whose logs can be used", "record more")
    units = _list_parameters(logs)
    values, stds = (
        logs.reindex(columns=[f"{kind}.{name}" for name in units]).astype(float).set_axis([*units], axis=1)
        for kind in ("value", "std")
    )
    compared = compare_units(values, stds, logs["label"].tolist(), logs["time"], reference=of_fleet)
    known = compared.population
    errors = (1 / (stds**2 + known["repeat"] ** 2)).groupby(
        logs["label"].to_numpy()
    ).sum() ** -0.5  # without any value infinite
    is_vague = errors > np.hypot(known["spread"], SCATTER * errors.loc[siblings].median())
    judged = [_judge_unit(str(unit), rows, compared, is_vague) for unit, rows in table.groupby("serial", sort=True)]
    order = [Verdict.FAIL, Verdict.RETEST, Verdict.PASS]
    judged.sort(key=lambda one: (order.index(one.verdict), min((own.p_value for own in one.deviations), default=1.0)))
    owners, diagnosed = _list_owners(table)
    common = sorted(owners.items(), key=lambda one: -len(one[1]))
    return Fleet(
        rig=rig.name,
        payload=rig.payload,
        reference=reference,
        logs=len(table),
        failed=int(table["error"].notna().sum()),
        units=tuple(judged),
        population=known.assign(unit=units, detectable=compared.detectable.loc[siblings].median()),
        estimates=compared.values,
        causes=tuple(FleetCause(cause, joint, len(having), len(diagnosed)) for (cause, joint, _), having in common),
        is_dated=manifest.is_dated,
        table=table.drop(columns=["own", "reported"]),
    )


def _find_start(rows: DataFrame, key: FindingKey) -> str | None:
    """When the first of a unit's logs was taken that has a cause; None where no earlier one was diagnosed."""
    ordered = rows.sort_values("time", kind="stable")
    first = ordered[[key in own for own in ordered["own"]]].iloc[0]
    return str(first["taken"]) if ordered["verdict"][ordered["time"] < first["time"]].notna().any() else None


def _judge_unit(unit: str, rows: DataFrame, compared: Comparison, is_vague: DataFrame) -> JudgedUnit:
    """Return a unit's verdict from its logs."""
    uncertain = tuple(is_vague.columns[is_vague.loc[unit]]) if unit in is_vague.index else ()
    deviations = tuple(own for own in compared.deviations if own.unit == unit)
    failed = rows[rows["error"].notna()]
    keys = dict.fromkeys(chain(*rows["own"]))
    own = [UnitCause(cause, joint, status, _find_start(rows, (cause, joint, status))) for cause, joint, status in keys]
    fails = {
        Reason.ODD_PARAMETER: bool(deviations),
        Reason.OWN_CAUSE: any(status == "named" for *_, status in chain(*rows["own"][~rows["spoilt"]])),
    }
    doubts = {
        Reason.DATA: bool(failed["reported"].any() or rows["spoilt"].any()),
        Reason.ERROR: not failed["reported"].all(),
        Reason.UNCERTAIN: bool(uncertain),
    }
    verdict = Verdict.FAIL if any(fails.values()) else Verdict.RETEST if any(doubts.values()) else Verdict.PASS
    reasons = tuple(reason for reason, holds in {**fails, **doubts}.items() if holds)
    errors = tuple(error.replace(log, PurePosixPath(log).name) for log, error in zip(failed["log"], failed["error"]))
    return JudgedUnit(unit, verdict, reasons, len(rows), deviations, tuple(own), uncertain, errors)
