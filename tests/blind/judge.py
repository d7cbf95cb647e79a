"""One case judged: what a diagnosis (`diagnose --json`) got right and wrong of a truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .conventions import COMPANY, PARTS, READINGS, Reading

Json = Mapping[str, Any]
VISIBLE = 3.0
"""Projected effect over noise floor from which an effect counts as visible."""


@dataclass(frozen=True)
class Judged:
    """A truth and its diagnosis, with the findings that are stated and not excused by the log's own faults."""

    truth: Json
    diagnosis: Json
    findings: tuple[Json, ...]

    @property
    def causes(self):
        """What was hidden."""
        return self.truth["causes"]

    @property
    def verdict(self):
        """The diagnosis in one word."""
        return str(self.diagnosis["verdict"])

    @property
    def stratum(self):
        """Which part of the set the case is of."""
        return str(self.truth["stratum"])


def judge(truth, diagnosis):
    """Set aside what is unconfirmed, faults that the log truly has, and what a form brings along besides its cause."""
    faults = set(truth["faults"])
    besides = {(COMPANY.get((one["cause"], one["form"])), one["joint"]) for one in truth["causes"]}
    left = tuple(
        found
        for found in diagnosis["findings"]
        if found["status"] != "unconfirmed"
        and not faults & names_of(found)
        and (found["cause"], found["joint"]) not in besides
    )
    return Judged(truth, diagnosis, left)


def names_of(finding):
    """Every cause that a finding holds possible."""
    return {finding["cause"], *finding.get("class", ())}


def confident(finding):
    """Whether a finding is told as a fact."""
    return finding["status"] == "named"


def same_joint(finding, cause):
    """Whether both speak of one joint, or one of them of the whole rig."""
    return finding["joint"] is None or cause["joint"] is None or finding["joint"] == cause["joint"]


def tells(finding, cause):
    """Whether a finding, or its class, is this cause on this joint."""
    return cause["cause"] in names_of(finding) and same_joint(finding, cause)


def near(finding, cause):
    """The same, or a published cause that comes near one from outside."""
    alike = {cause["cause"], *cause["kin"]}
    return bool(names_of(finding) & alike) and same_joint(finding, cause)


def visible(cause, joint=None):
    """Whether the projected effect is VISIBLE noise floors: at this joint, or on its own, or where it is largest."""
    values = cause["snr"]
    place = joint or cause["joint"] or max(values, key=values.get)
    return values[place] >= VISIBLE


def first_right(case):
    """Whether the strongest finding tells the (only) hidden cause."""
    return bool(case.findings) and tells(case.findings[0], case.causes[0])


def named_wrong(case):
    """Whether anything is named that was not hidden."""
    named = filter(confident, case.findings)
    return any(not any(tells(found, cause) for cause in case.causes) for found in named)


def all_found(case):
    """Whether every hidden cause is told by some finding."""
    return all(any(tells(found, cause) for found in case.findings) for cause in case.causes)


def false_alarm(case):
    """On a log with nothing in it: 1 for any finding, a half for "unknown" (or unexcused "data")."""
    if case.findings:
        return 1.0
    doubtful = ("unknown",) if case.truth["faults"] else ("unknown", "data")
    return 0.5 if case.verdict in doubtful else 0.0


def get_errors(diagnosis):
    """Return each joint's held-out torque error before and after all findings, N m; schema 1 has them at the top."""
    stages = diagnosis.get("held_out") or {"refitted": diagnosis.get("baseline"), **diagnosis}
    before, after = (
        (stages.get(stage) or {}).get("torque_rmse", {}) for stage in ("refitted", "extended")
    )
    return {joint: (before[joint], after[joint]) for joint in before}


def gain_recovered(case):
    """(before - after) / (before - oracle) of the held-out torque error on the joint with the largest hidden effect.

    The oracle leaves the noise floor. None where it gains less than a tenth: there is nothing to recover, or where the
    diagnosis states no errors."""
    cause = case.causes[0]
    size = cause["projected_rms"]
    joint = cause["joint"] or max(size, key=size.get)
    errors = get_errors(case.diagnosis)
    if joint not in errors:
        return None
    before, after = errors[joint]
    oracle = case.truth["noise_floor"][joint]
    return (before - after) / (before - oracle) if before - oracle > 0.1 * before else None


def covered(case):
    """For each parameter of a rightly told cause in a known form: is the truth within 1.96 standard deviations?"""
    hits = []
    for cause in case.causes:
        alike = [f for f in case.findings if f["cause"] == cause["cause"] and same_joint(f, cause)]
        if not alike or not cause["comparable"]:
            continue
        for name, true in cause["parameters"].items():
            usual = READINGS.get((cause["cause"], name), Reading(name))
            reading = PARTS.get((cause["cause"], cause["form"], name), usual)
            told = alike[0]["parameters"].get(reading.name) if reading else None
            if told and told.get("std") is not None:
                off = reading.factor * told["value"] + reading.shift - true
                hits.append(abs(off) <= 1.96 * abs(reading.factor) * told["std"])
    return hits
