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
    """A truth and its diagnosis, with the findings that are not excused by the log's own faults."""

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
    """Set aside findings of faults that the log truly has, and of what a form brings along besides its cause."""
    faults = set(truth["faults"])
    besides = {
        (COMPANY.get((cause["cause"], cause.get("form", ""))), cause["joint"])
        for cause in truth["causes"]
    }
    left = tuple(
        found
        for found in diagnosis["findings"]
        if not faults & names_of(found) and (found["cause"], found["joint"]) not in besides
    )
    return Judged(truth, diagnosis, left)


def names_of(finding):
    """Every cause that a finding holds possible."""
    return {finding["cause"], *finding.get("class", ())}


def confident(finding):
    """Whether a finding is told as a fact."""
    return bool(finding["status"] == "named")


def same_joint(finding, cause):
    """Whether both speak of one joint, or one of them of the whole rig."""
    return finding["joint"] is None or cause["joint"] is None or finding["joint"] == cause["joint"]


def tells(finding, cause):
    """Whether a finding, or its class, is this cause on this joint."""
    return cause["cause"] in names_of(finding) and same_joint(finding, cause)


def near(finding, cause):
    """The same, or a published cause that comes near one from outside."""
    return tells(finding, cause) or (
        bool(names_of(finding) & set(cause["kin"])) and same_joint(finding, cause)
    )


def visible(cause, joint=None):
    """Whether the projected effect is VISIBLE noise floors: at this joint, or on its own, or where it is largest."""
    values = cause["snr"]
    place = joint or cause["joint"]
    return (max(values.values()) if place is None else values[place]) >= VISIBLE


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


def fault_told(case):
    """Whether the planted fault of the data is among what is told."""
    told = {name for found in case.diagnosis["findings"] for name in names_of(found)}
    return case.truth["data"]["cause"] in told


def false_alarm(case):
    """On a log with nothing in it: 1 for any finding, a half for "unknown" (or unexcused "data")."""
    if case.findings:
        return 1.0
    excused = bool(case.truth["faults"])
    doubtful = case.verdict == "unknown" or (case.verdict == "data" and not excused)
    return 0.5 if doubtful else 0.0


def gain_recovered(case):
    """(before - after) / (before - oracle) of the held-out torque error on the joint with the largest hidden effect.

    The oracle leaves the noise floor. None where it gains less than a tenth: there is nothing to recover."""
    cause = case.causes[0]
    size = cause["projected_rms"]
    joint = cause["joint"] or max(size, key=lambda name: size[name])
    before = float(case.diagnosis["baseline"]["torque_rmse"][joint])
    after = float(case.diagnosis["extended"]["torque_rmse"][joint])
    oracle = float(case.truth["noise_floor"][joint])
    return (before - after) / (before - oracle) if before - oracle > 0.1 * before else None


def covered(case):
    """For each parameter of a rightly told cause in a known form: is the truth within 1.96 standard deviations?"""
    hits = []
    for cause in (item for item in case.causes if item["comparable"]):
        found = next(
            (f for f in case.findings if f["cause"] == cause["cause"] and same_joint(f, cause)),
            None,
        )
        for name, true in cause["parameters"].items() if found else ():
            usual = READINGS.get((cause["cause"], name), Reading(name))
            reading = PARTS.get((cause["cause"], cause.get("form", ""), name), usual)
            told = found["parameters"].get(reading.name) if found and reading else None
            if reading and told is not None and told.get("std") is not None:
                off = reading.factor * float(told["value"]) + reading.shift - float(true)
                hits.append(abs(off) <= 1.96 * abs(reading.factor) * float(told["std"]))
    return hits
