"""A diagnosis of a measured log in one of five classes, by what is known of the device."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from real_data.known import Known, Size
from real_data.running import Outcome
from tests.blind.judge import get_errors

Json = dict[str, Any]

WORSE = 1.1
"""Ratio of held-out errors from which a named finding harms: a tenth, as a model may lose to least squares."""
PREDICTS = 0.5
"""Share of the held-out torque's power that least squares must explain for a refusal to be one."""


class Class(StrEnum):
    """What a diagnosis is worth."""

    RIGHT = "right"
    HONEST = "honest"
    WRONG = "wrong"
    REFUSED = "refused"
    ERROR = "error"
    UNKNOWN = "unknown"
    """Nothing is known of the device, so that no diagnosis can be judged."""


@dataclass(frozen=True)
class Judgement:
    """A log's line; `why` is empty where it is right or honest."""

    device: str
    log: str
    judged: Class
    verdict: str
    why: str

    def __str__(self) -> str:
        """One line."""
        why = f"  <- {self.why}" if self.why else ""
        return f"{self.device:24.24}  {self.log:28}  {self.judged:8}  {self.verdict}{why}"


def judge(
    log: str, known: Known | None, outcome: Outcome, explained: Callable[[], float]
) -> Judgement:
    """Return a diagnosis's class; `explained` is least squares' share of the held-out torque, asked at a refusal."""
    told = outcome.result
    if known is None:
        return Judgement(
            "?",
            log,
            Class.UNKNOWN,
            describe(outcome),
            "add what is known of the device to known.py",
        )
    if not outcome.sound or (told is None and outcome.exit == 0):
        return Judgement(
            known.device,
            log,
            Class.ERROR,
            outcome.said,
            "no answer and no single line that says why",
        )
    if told is None:
        share = explained() if known.has_torque else 0.0
        refused = share > PREDICTS
        why = (
            f"least squares explains {100 * share:.0f} % of the held-out torque" if refused else ""
        )
        return Judgement(
            known.device, log, Class.REFUSED if refused else Class.HONEST, outcome.said, why
        )
    if why := "; ".join(dict.fromkeys(contradictions(told, known))):
        return Judgement(known.device, log, Class.WRONG, describe(outcome), why)
    judged = Class.RIGHT if is_found(told, known) else Class.HONEST
    return Judgement(known.device, log, judged, describe(outcome), "")


def named(told: Json, *causes: str) -> list[Json]:
    """Return the findings that have a name, of these causes or of all but the data's."""
    return [
        f
        for f in told["findings"]
        if f["status"] == "named" and (not causes or f["cause"] in causes)
    ]


def values(finding: Json, name: str) -> list[float]:
    """Return the values of the parameters that are called so, with or without a number behind."""
    found = finding["parameters"].items()
    return [
        p["value"]
        for key, p in found
        if re.fullmatch(rf"{name}[_ ]?\d*", key) and p["value"] is not None
    ]


def harmonics(told: Json) -> set[int]:
    """Return the harmonics per turn at which cogging is named."""
    return {round(k) for finding in named(told, "cogging") for k in values(finding, "harmonic")}


def is_of(finding: Json, cause: str) -> bool:
    """Whether a finding is of ``cause`` or ``cause@joint``, where ``*`` stands for any cause."""
    name, _, joint = cause.partition("@")
    return name in ("*", finding["cause"]) and joint in ("", finding["joint"])


def is_found(told: Json, known: Known) -> bool:
    """Whether all that is known of the device is found; never where nothing is known."""
    found = [f for f in told["findings"] if f["status"] in ("named", "data")]
    each = (any(is_of(f, cause) for f in found for cause in one.split("|")) for one in known.found)
    errors = get_errors(told)
    asked = [errors[known.at]] if known.at in errors else errors.values()
    gained = all(after <= known.share * before for before, after in asked)
    return bool(known.found) and all(each) and gained and known.harmonics <= harmonics(told)


def contradictions(told: Json, known: Known) -> Iterator[str]:
    """Yield why what is named or stated cannot be."""
    if not known.has_torque:
        yield "the log holds no torque"
    for finding in told["findings"]:
        is_fault = finding["status"] == "data" and finding.get("makes_physics_unreliable", True)
        if is_fault and finding["cause"] not in known.faults:
            yield f"{finding['cause']}: the data have no such fault"
    for finding in named(told):
        where = f"{finding['cause']} at {finding['joint'] or 'rig'}"
        if any(is_of(finding, cause) for cause in known.denied):
            yield f"{where}: the device has none"
        sizes = [p for p in finding["parameters"].values() if p["std"] and p["value"] is not None]
        if sizes and all(abs(p["value"]) < 2 * p["std"] for p in sizes):
            yield f"{where}: no size is known to two deviations"
        yield from (f"{where}: {text}" for one in known.sizes for text in misses(finding, one))
        yield from (f"{where}: inertia {x:.3g} kg m²" for x in values(finding, "inertia") if x <= 0)
    if any(f["status"] == "named" for f in told["findings"]):
        for joint, (before, after) in get_errors(told).items():
            if after > WORSE * before:
                yield f"held-out error at {joint} grows, {before:.3g} → {after:.3g}"
    for sentence in (
        *map(str, told.get("notes", [])),
        *(str(f.get("sentence")) for f in told["findings"]),
    ):
        less = re.findall(r"inertia[^.;]* is ([\d.]+) ± [\d.]+ % less", sentence)
        yield from (f"an inertia {x} % less" for x in less if float(x) > 100)
        lighter = re.findall(r"([\d.]+) ± [\d.]+ g lighter than the stated ([\d.]+) g", sentence)
        yield from (
            f"{x} g lighter than {all_of_it} g"
            for x, all_of_it in lighter
            if float(x) >= float(all_of_it)
        )


def misses(finding: Json, size: Size) -> Iterator[str]:
    """Yield a finding's parameter of which two deviations do not reach its interval."""
    if finding["cause"] != size.cause or size.joint not in (None, finding["joint"]):
        return
    one = finding["parameters"].get(size.parameter)
    if one is not None and one["value"] is not None:
        slack = 2 * (one["std"] or 0.0)
        if not size.low - slack <= one["value"] <= size.high + slack:
            yield f"{quantity(size.parameter, one)}, known {size.low:.3g} to {size.high:.3g}"


def describe(outcome: Outcome) -> str:
    """Return a diagnosis's verdict and findings in a few words; of other verbs, how they ended."""
    told = outcome.result or {}
    if "verdict" not in told:
        return outcome.said
    return f"{told['verdict']}: {', '.join(dict.fromkeys(map(describe_finding, told['findings']))) or 'no finding'}"


def describe_finding(finding: Json) -> str:
    """Return cause, joint, mark, probability and sizes; phases are left out, harmonics stand as a list."""
    where = f" at {finding['joint']}" if finding["joint"] else ""
    mark = "" if finding["status"] == "named" else f" [{finding['status']}]"
    chance = "" if finding.get("probability") is None else f" p {finding['probability']:.2f}"
    if finding["status"] == "data":
        return f"{finding['cause']}{where}{mark}{chance}"
    told = finding["parameters"].items()
    parts = [quantity(k, p) for k, p in told if not k.startswith(("phase", "harmonic"))]
    if at := sorted(values(finding, "harmonic")):
        parts = ["k " + "/".join(f"{k:g}" for k in at), *parts[:1]]
    return f"{finding['cause']}{where}{mark}{chance} ({', '.join(parts[:3])})"


def quantity(name: str, parameter: Json) -> str:
    """Return a name, a value, its deviation and unit."""
    std = "" if parameter["std"] is None else f" ± {parameter['std']:.2g}"
    unit = "" if parameter["unit"] in ("", "1") else f" {parameter['unit']}"
    value = "?" if parameter["value"] is None else f"{parameter['value']:.3g}"
    return f"{name} {value}{std}{unit}"
