"""What one log of a fleet says of its unit: parameters, how well they hold, and what is wrong."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.errors import DataError, GimbalPinError
from gimbal_pin.fleet.engine import Value
from gimbal_pin.fleet.manifest import FleetLog, local_copy
from gimbal_pin.identification import identify
from gimbal_pin.log.io import read_log
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class LogStudy:
    """What every log of a fleet goes through; workers get it with their logs.

    Attributes:
        rig: The rig that all units are built as.
        cutoff: Of the identification's filter, Hz; None: the usual one.
        quick: Whether the logs are identified only, and not diagnosed.
        seed: Seed of the diagnosis.
    """

    rig: Rig
    cutoff: float | None = None
    quick: bool = False
    seed: int = 0

    def examine(self, log: FleetLog) -> dict[str, Value]:
        """Return a log's row; the `error` of one that cannot be used is the row's.

        `value.NAME` and `std.NAME` per parameter, from the whole log, `units` their units; `torque_rmse.JOINT`, N m,
        and `fit_percent.JOINT` on the third that a second fit has not seen; `findings` as JSON: cause, joint, status.
        """
        head: dict[str, Value] = {"log": log.path, "serial": log.unit, "time": log.time}
        copy = Path(log.path)
        try:
            with local_copy(log.path) as copy:
                return {**head, **self.study(read_log(copy, self.rig, log.mapping))}
        except GimbalPinError as error:
            return {**head, "error": str(error).replace(str(copy), log.path)}

    def study(self, log: Log) -> dict[str, Value]:
        """Identify and diagnose a log."""
        filtering = None if self.cutoff is None else Filtering(cutoff=self.cutoff)
        whole = identify(self.rig, [log], holdout="none", filtering=filtering)
        units = json.dumps(dict(zip(whole.names, whole.units)))
        row: dict[str, Value] = {"seconds": float(log.t[-1] - log.t[0]), "samples": len(log), "units": units}
        row |= zip((f"value.{name}" for name in whole.names), whole.estimate.theta.tolist())
        row |= zip((f"std.{name}" for name in whole.names), whole.estimate.std.tolist())
        try:
            judged = identify(self.rig, [log], filtering=filtering).held_out
        except DataError:  # its first two thirds do not show every parameter
            judged = None
        for figure in ("torque_rmse", "fit_percent"):
            known = getattr(judged, figure, {})
            row |= {f"{figure}.{joint}": known.get(joint) for joint in self.rig.joints}
        return row if self.quick else {**row, **self.diagnose(log)}

    def diagnose(self, log: Log) -> dict[str, Value]:
        """Return verdict and findings; a log that is too short for them has neither, and `undiagnosed` says why."""
        try:
            found = diagnose(self.rig, [log], rng=np.random.default_rng(self.seed))
        except DataError as error:
            return {"verdict": None, "findings": "[]", "undiagnosed": str(error)}
        findings = [{"cause": one.cause, "joint": one.joint, "status": "data"} for one in found.spoiling]
        findings += [{"cause": one.cause, "joint": one.joint, "status": one.status} for one in found.findings]
        return {"verdict": found.verdict, "findings": json.dumps(findings), "undiagnosed": None}
