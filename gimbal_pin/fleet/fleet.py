"""Many rigs' logs compared: which unit is not like its siblings, in what, and since when."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.fleet.engine import RUN, Capacity, ExecutorFactory, compute_table, file_system, read_table
from gimbal_pin.fleet.manifest import Manifest, read_manifest
from gimbal_pin.fleet.population import Deviation, DeviationKind, FleetParameter, UnitEstimate, compare_units
from gimbal_pin.fleet.study import describe_rig
from gimbal_pin.fleet.units import LogStudy
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from pandas import DataFrame

SCATTER = 3.0
"""How far apart the stated errors of like logs may lie: of one motion of 8 s with other noise they differ by up to a
factor of 2.4 (turret, 16 logs)."""
MAJORITY = 0.5
"""Share of the siblings from which a cause or a fault is the fleet's way rather than a unit's own."""


class Verdict(Enum):
    """What becomes of a unit."""

    PASS = "pass"
    FAIL = "fail"
    RETEST = "retest"


class Reason(Enum):
    """Why a unit does not pass."""

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


CERTAIN = ("named", "data")
"""Statuses of findings that are counted."""
EARLIER = "earlier/"
"""Put before the serial numbers of the fleet that units are judged against."""
FAILING = {Reason.ODD_PARAMETER, Reason.OWN_CAUSE}


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
        status: One of `CERTAIN`.
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
        estimate: Its parameters, partially pooled with the fleet's; None where no log could be used.
    """

    unit: str
    verdict: Verdict
    reasons: tuple[Reason, ...]
    logs: int
    deviations: tuple[Deviation, ...] = ()
    causes: tuple[UnitCause, ...] = ()
    uncertain: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    estimate: UnitEstimate | None = field(default=None, repr=False)

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Fleet:
    """The result of `compare_fleet`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        reference: Folder of the fleet that units are judged against; None: against each other.
        logs: Number of logs, and `failed` of these without a result.
        failed: See there.
        units: Those that fail first, then those to test again, then those that pass.
        population: The parameters over the fleet that units are judged against.
        parameter_units: Parameter → its SI unit.
        detectable: Parameter → offset that the median unit's logs show in one of two cases.
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
    population: tuple[FleetParameter, ...]
    parameter_units: Mapping[str, str] = field(repr=False)
    detectable: Mapping[str, float] = field(repr=False)
    causes: tuple[FleetCause, ...]
    is_dated: bool = field(repr=False)
    table: DataFrame = field(repr=False)

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
        return {
            "schema": 1,
            "rig": self.rig,
            "payload": self.payload,
            "reference": self.reference,
            "logs": self.logs,
            "failed": self.failed,
            "counts": {verdict.value: count for verdict, count in self.counts.items()},
            "units": [
                {
                    "unit": one.unit,
                    "verdict": one.verdict.value,
                    "reasons": [reason.value for reason in one.reasons],
                    "logs": one.logs,
                    "deviations": [
                        {**asdict(own), "kind": own.kind.value, "score": own.score, "since": self.since(own)}
                        for own in one.deviations
                    ],
                    "causes": [asdict(cause) for cause in one.causes],
                    "uncertain": list(one.uncertain),
                    "errors": list(one.errors),
                }
                for one in self.units
            ],
            "population": [
                {**asdict(own), "unit": self.parameter_units[own.name], "detectable": self.detectable[own.name]}
                for own in self.population
            ],
            "causes": [asdict(cause) for cause in self.causes],
        }

    def to_frame(self) -> DataFrame:
        """Return one row per unit: verdict, reasons, and its parameters, partially pooled with the fleet's."""
        import pandas as pd

        names = [own.name for own in self.population]
        return pd.DataFrame.from_records(
            {
                "unit": one.unit,
                "verdict": one.verdict.value,
                "reasons": ", ".join(reason.value for reason in one.reasons),
                "logs": one.logs,
                **({} if one.estimate is None else dict(zip(names, one.estimate.values.tolist()))),
            }
            for one in self.units
        )


def compare_fleet(
    logs: str | Path | Manifest,
    *,
    rig: str | Path | Rig | None = None,
    payload: str | None = None,
    folder: str | None = None,
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
    study = LogStudy(loaded, manifest.cutoff, quick, seed)
    table = compute_table(study.examine, manifest.logs, settings, folder, executor, workers, quiet)
    table["reported"] = table["log"].notna() if "log" in table else False
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
    files, place = file_system(folder)
    try:
        earlier = json.loads(files.cat_file(f"{place}/{RUN}"))["settings"]
        table = read_table(folder)
        known = table[table["error"].isna()].assign(reported=True)
        lacking = {"serial", "time", "units"} - set(known)
    except (OSError, ValueError, KeyError, TypeError) as error:
        missing = isinstance(error, FileNotFoundError)
        what = "is no folder of an earlier fleet" + ("" if missing else f" ({type(error).__name__}: {error})")
        raise UsageError("--reference", f"{folder} {what}", "give what 'gimbal-pin fleet -o' wrote") from error
    if lacking or known.empty:
        raise UsageError("--reference", f"{folder} has no identified logs", "give what 'gimbal-pin fleet -o' wrote")
    for key in ("rig", "payload", "cutoff"):
        if earlier.get(key) != settings[key]:
            what = f"has the {key} {earlier.get(key)}, and these logs {settings[key]}"
            raise UsageError("--reference", f"{folder} {what}", f"compare units of one {key}")
    return known


@dataclass(frozen=True)
class _Causes:
    """Which units have a cause: (cause, joint, "named" or "data") → units, of those that were diagnosed."""

    having: Mapping[tuple[str, str | None, str], set[str]]
    diagnosed: set[str]

    def list_own(self, unit: str, findings: Sequence[Mapping[str, Any]]) -> list[tuple[str, str | None, str]]:
        """Return those of a unit's findings that less than `MAJORITY` of its siblings have."""
        others = self.diagnosed - {unit}
        keys = dict.fromkeys(key for one in findings if (key := _key_of(one))[2] in CERTAIN)
        return [key for key in keys if others and len(self.having.get(key, set()) - {unit}) < MAJORITY * len(others)]


def _key_of(finding: Mapping[str, Any]) -> tuple[str, str | None, str]:
    """What is counted of a finding."""
    return finding["cause"], finding["joint"], finding["status"]


def _read_findings(table: DataFrame) -> list[list[dict[str, Any]]]:
    """Findings of each log; none of one that was not diagnosed."""
    if "findings" not in table:
        return [[] for _ in range(len(table))]
    return [json.loads(text) if isinstance(text, str) else [] for text in table["findings"]]


def _count_causes(table: DataFrame) -> _Causes:
    """Which units have which named cause or fault."""
    having: dict[tuple[str, str | None, str], set[str]] = {}
    for unit, findings in zip(table["serial"], _read_findings(table)):
        for key in map(_key_of, findings):
            if key[2] in CERTAIN:
                having.setdefault(key, set()).add(unit)
    is_diagnosed = table["verdict"].notna() if "verdict" in table else np.zeros(len(table), bool)
    return _Causes(having, set(table["serial"][is_diagnosed]))


def _list_parameters(table: DataFrame) -> dict[str, str]:
    """Parameters that at least half of the logs tell, as a base that moves shows more → their units."""
    units, count = dict[str, str](), Counter[str]()
    for text, logs in table["units"].value_counts().items():
        own = json.loads(str(text))
        units |= own
        count.update(dict.fromkeys(own, int(logs)))
    return {name: unit for name, unit in units.items() if count[name] >= MAJORITY * len(table)}


def _judge_fleet(
    rig: Rig, manifest: Manifest, reference: str | None, table: DataFrame, earlier: DataFrame | None
) -> Fleet:
    """Return what the rows say of each unit."""
    import pandas as pd

    of_these = _count_causes(table)
    causes = of_these if earlier is None else _count_causes(earlier)
    for rows in (table,) if earlier is None else (table, earlier):
        rows["own"] = [causes.list_own(*row) for row in zip(rows["serial"], _read_findings(rows))]
        rows["spoilt"] = [any(key[2] == "data" for key in keys) for keys in rows["own"]]
    used = table[table["error"].isna() & ~table["spoilt"]]
    if used.empty:
        why = f": {table['error'].dropna().iloc[0]}" if table["error"].notna().any() else ""
        raise DataError(manifest.place, f"has no log that can be used{why}", "record them as 'gimbal-pin check' says")
    compared_logs, of_fleet = used.assign(label=used["serial"]), None
    if earlier is not None:  # a unit may have been in the earlier fleet under the same serial number
        earlier = earlier[~earlier["spoilt"]]
        of_fleet = sorted({f"{EARLIER}{unit}" for unit in earlier["serial"]})
        compared_logs = pd.concat([compared_logs, earlier.assign(label=EARLIER + earlier["serial"])])
    siblings = of_fleet or sorted(set(used["serial"]))
    if len(siblings) < 2:
        raise DataError(manifest.place, "has fewer than two units whose logs can be used", "record more")
    units = _list_parameters(compared_logs)
    values, stds = (
        compared_logs.reindex(columns=[f"{kind}.{name}" for name in units]).to_numpy(dtype=float)
        for kind in ("value", "std")
    )
    times = compared_logs["time"].to_numpy(dtype=float)
    compared = compare_units(list(units), values, stds, list(compared_logs["label"]), times, reference=of_fleet)
    spread, repeat = (np.array([getattr(own, kind) for own in compared.population]) for kind in ("spread", "repeat"))
    precision = pd.DataFrame(1 / (stds**2 + repeat**2), columns=list(units)).groupby(list(compared_logs["label"])).sum()
    errors = precision**-0.5  # of a unit without any such value infinite
    is_vague = errors > np.hypot(spread, SCATTER * errors.loc[siblings].median())
    detectable = np.median([compared.estimates[unit].detectable for unit in siblings], axis=0)
    deviations: dict[str, list[Deviation]] = {}
    for deviation in compared.deviations:
        deviations.setdefault(deviation.unit, []).append(deviation)
    judged = [
        _judge_unit(
            str(unit),
            rows,
            deviations.get(str(unit), ()),
            compared.estimates.get(str(unit)),
            tuple(name for name in units if unit in is_vague.index and is_vague.at[unit, name]),
        )
        for unit, rows in table.groupby("serial", sort=True)
    ]
    worst = {unit: own[0].p_value for unit, own in deviations.items()}
    order = [Verdict.FAIL, Verdict.RETEST, Verdict.PASS]
    judged.sort(key=lambda one: (order.index(one.verdict), worst.get(one.unit, 1.0)))
    return Fleet(
        rig=rig.name,
        payload=rig.payload,
        reference=reference,
        logs=len(table),
        failed=int(table["error"].notna().sum()),
        units=tuple(judged),
        population=compared.population,
        parameter_units=units,
        detectable=dict(zip(units, detectable.tolist())),
        causes=tuple(
            FleetCause(cause, joint, len(having), len(of_these.diagnosed))
            for (cause, joint, _), having in sorted(of_these.having.items(), key=lambda one: -len(one[1]))
        ),
        is_dated=manifest.is_dated,
        table=table.drop(columns=["own", "reported"]),
    )


def _find_start(rows: DataFrame, key: tuple[str, str | None, str]) -> str | None:
    """When the first of a unit's logs was taken that has a cause; None where no earlier one was diagnosed."""
    ordered = rows.sort_values("time", kind="stable")
    has = np.array([key in own for own in ordered["own"]])
    first = int(has.argmax())
    is_diagnosed = ordered["verdict"].notna().to_numpy() & (ordered["time"] < ordered["time"].iloc[first]).to_numpy()
    return str(ordered["taken"].iloc[first]) if is_diagnosed.any() else None


def _judge_unit(
    unit: str,
    rows: DataFrame,
    deviations: Sequence[Deviation],
    estimate: UnitEstimate | None,
    uncertain: tuple[str, ...],
) -> JudgedUnit:
    """Return a unit's verdict from its logs."""
    failed = rows[rows["error"].notna()]
    keys = list(dict.fromkeys(key for own in rows["own"] for key in own))
    is_so = {
        Reason.ODD_PARAMETER: bool(deviations),
        Reason.OWN_CAUSE: any(key[2] == "named" for own in rows["own"][~rows["spoilt"]] for key in own),
        Reason.DATA: bool(failed["reported"].any() or rows["spoilt"].any()),
        Reason.ERROR: bool((~failed["reported"]).any()),
        Reason.UNCERTAIN: bool(uncertain),
    }
    reasons = tuple(reason for reason, holds in is_so.items() if holds)
    verdict = Verdict.FAIL if FAILING & set(reasons) else Verdict.RETEST if reasons else Verdict.PASS
    return JudgedUnit(
        unit,
        verdict,
        reasons,
        len(rows),
        tuple(deviations),
        tuple(
            UnitCause(cause, joint, status, _find_start(rows, (cause, joint, status))) for cause, joint, status in keys
        ),
        uncertain,
        tuple(error.replace(log, PurePosixPath(log).name) for log, error in zip(failed["log"], failed["error"])),
        estimate,
    )
